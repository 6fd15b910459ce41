"""The pose of a camera with known intrinsics: E, the rotation, and the translation where it is known.

E has five parameters and is fitted as F is, from F and from the likeliest direction of translation. The
covariance is that of the curvature of the cost plus, where few smears are independent, that of the likelihood
over all directions of translation (`DirectionLikelihood`), with all correlation of neighbouring smears.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.configuration import Configuration
from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.pose import PoseCovariance, RigidTransform, plane_basis, rotation_matrix
from blur2view.two_view import constants as c
from blur2view.two_view.choice import Choice
from blur2view.two_view.fundamental import DirectionLikelihood, FundamentalFit, fit_best
from blur2view.two_view.homography import FieldLikelihood
from blur2view.two_view.likelihood import NormalisedSmears
from blur2view.two_view.models import FundamentalManifold, cayley
from blur2view.two_view.order import pose_before_both

POSE = [2, 3, 4, 0, 1]  # rotation, then translation, of the parameters of `FundamentalManifold`
ANY_DIRECTION = (np.pi - 2) / 2  # squared radians: variance of an axis of any direction along each tangent


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatedPose:
    """The pose, its covariance, and E where that was fitted."""

    cam2_from_cam1: RigidTransform
    covariance: PoseCovariance
    E: Array | None = None  # (3, 3), from which F is computed anew; None where F stays as fitted


def estimate_pose(smears: NormalisedSmears, fit: FundamentalFit, choice: Choice) -> EstimatedPose:
    """Return the pose of known intrinsics for a choice with F or H, given the F of least cost.

    The translation is given where parallax is proven, or where its direction is known to KNOWN_DEG and the
    configuration is not PANORAMIC. Else it is zero, and the rotation is that of a PANORAMIC field, or the
    mean over all directions of translation.
    """
    field, correlated = choice.homography, smears.fully_correlated
    if choice.config is Configuration.PANORAMIC and field is not None:
        likelihood = FieldLikelihood(smears=field.likelihood.smears.fully_correlated)
        spread = replace(field, likelihood=likelihood).covariance()[:3, :3]
        return rotation_alone(field.family.parameters[:3], spread)
    directions = DirectionLikelihood(smears=correlated)
    point, pose = fit_calibrated(smears, fit.point, directions)
    tangents = np.copysign(1.0, pose.translation @ point.t) * plane_basis(point.t)
    mean, region = spread_over(directions, pose, tangents)
    matrix = covariance_at(point, correlated)
    if not correlated.has_many_independent:  # of many the likelihood is narrower than the grid's steps
        matrix = matrix + region
    covariance = PoseCovariance(matrix=matrix, tangents=tangents)
    proven = choice.config is Configuration.UNCALIBRATED
    if proven or covariance.translation_sigma_deg < c.KNOWN_DEG:
        return EstimatedPose(cam2_from_cam1=pose, covariance=covariance, E=pose.essential)
    off = mean - pose.rotation_vector
    unseen = c.UNSEEN * float(np.median(smears.matches.length_px)) / smears.unit_px
    spread = region[:3, :3] - np.outer(off, off) + unseen**2 * np.eye(3)
    return replace(rotation_alone(mean, spread), E=pose.essential if choice.reports_F else None)


def fit_calibrated(
    smears: NormalisedSmears, start: FundamentalManifold, directions: DirectionLikelihood
) -> tuple[FundamentalManifold, RigidTransform]:
    """Return the E of least cost, started from the F given and the likeliest translation, and its pose."""
    ((rotation, t),) = directions.likeliest(1)
    likeliest = FundamentalManifold(t=t, R=rotation_matrix(rotation), prior_sigma=smears.prior_sigma)
    point = fit_best([start, likeliest], smears).point
    residuals = smears.residuals(point.matrix())
    inliers = residuals.weights.sum(axis=0)
    return point, pose_before_both(point.matrix(), smears.ends, residuals.forward_share, inliers)


def spread_over(
    likelihood: DirectionLikelihood, pose: RigidTransform, tangents: Array
) -> tuple[Array, Array]:
    """Return the mean rotation vector (3,) over all directions of translation, and the spread about a pose.

    The spread (5, 5) has the parameters of `PoseCovariance` with the given tangents (2, 3): the mean of their
    squares and products over all directions, weighed by likelihood.
    """
    directions, rotations, costs, orders = likelihood.grid
    weight = np.exp(-0.5 * (costs - costs.min()))
    weight /= weight.sum()
    *_, (order,) = likelihood.at(pose.translation[None])
    sign = np.where(orders @ order < 0, -1.0, 1.0)[:, None]  # time runs as in the pose, or is reversed
    offset = sign * directions @ tangents.T
    angle = np.arccos(np.clip(sign[:, 0] * (directions @ pose.translation), -1.0, 1.0))
    offset *= (angle / np.maximum(np.linalg.norm(offset, axis=1), TINY))[:, None]
    both = np.concatenate([sign * rotations - pose.rotation_vector, offset], axis=1)
    matrix = (both * weight[:, None]).T @ both
    matrix[3:, 3:] += np.radians(c.GRID_STEP_DEG) ** 2 / 12 * np.eye(2)
    return weight @ (sign * rotations), matrix


def covariance_at(point: FundamentalManifold, correlated: NormalisedSmears) -> Array:
    """Return the covariance (5, 5) of rotation and translation: the inverse normal matrix times a factor.

    The factor, `COVARIANCE_FACTOR`, is there because the normal matrix takes orders and outliers as certain.
    """
    normal, _ = FundamentalFit.likelier(point, correlated).normal_equations()
    return np.asarray(c.COVARIANCE_FACTOR * np.linalg.pinv(normal[np.ix_(POSE, POSE)], hermitian=True), float)


def rotation_alone(vector: Array, covariance: Array) -> EstimatedPose:
    """Return the pose without translation of w (3,), the rotation being Cayley's transform of [w]x.

    ``covariance`` (3, 3) is that of w, squared radians.
    """
    matrix = np.diag([0.0, 0.0, 0.0, ANY_DIRECTION, ANY_DIRECTION])
    matrix[:3, :3] = covariance
    return EstimatedPose(
        cam2_from_cam1=RigidTransform(rotation=cayley(cross_matrix(vector)), translation=np.zeros(3)),
        covariance=PoseCovariance(matrix=matrix, tangents=np.eye(3)[:2]),
    )
