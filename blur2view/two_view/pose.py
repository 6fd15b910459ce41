"""The pose of a camera with known intrinsics: E, the rotation, and the translation where it is known.

E has five parameters and is fitted as F is, started from the likeliest direction of translation. The region
is the likelihood's spread over all directions (`DirectionLikelihood`), with all correlation of neighbouring
smears counted (`Likelihood.fully_correlated`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.pose import PoseCovariance, RigidTransform, plane_basis, rotation_matrix
from blur2view.geometry.two_view_geometry import Configuration
from blur2view.two_view import constants as c
from blur2view.two_view.choice import Choice
from blur2view.two_view.fundamental import DirectionLikelihood, FundamentalFit, fit_best
from blur2view.two_view.homography import FieldLikelihood
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import CameraF, cayley
from blur2view.two_view.order import pose_before_both

POSE = [2, 3, 4, 0, 1]  # a camera's parameters, rotation first
ANY_DIRECTION = (np.pi - 2) / 2  # squared radians: variance of an axis of any direction along each tangent


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatedPose:
    """The pose that is given, how sure it is, and why it is that."""

    cam2_from_cam1: RigidTransform
    covariance: PoseCovariance
    sentence: str
    E: Array | None  # (3, 3) of the intrinsics, which F becomes that of; None where a rotation explains all


def estimate_pose(likelihood: Likelihood, fit: FundamentalFit, choice: Choice) -> EstimatedPose:
    """Return the pose of known intrinsics for a choice with F or H, given the F of least cost.

    The translation is given where parallax is proven, or its direction known to KNOWN_DEG and no rotation
    explains the smears alone; else the pose is the rotation, whatever the translation.
    """
    if choice.config is Configuration.PANORAMIC and choice.homography is not None:
        field = choice.homography
        correlated = FieldLikelihood(smears=field.likelihood.smears.fully_correlated)
        spread = replace(field, likelihood=correlated).covariance()[:3, :3]
        why = "the rotation that explains the smears alone"
        return rotation_alone(field.family.parameters[:3], spread, why)
    directions = DirectionLikelihood(likelihood=likelihood.fully_correlated)
    point, pose = fit_calibrated(likelihood, fit.point, directions)
    mean, region = region_of(directions, pose)
    covariance = covariance_of(likelihood.fully_correlated, point, pose, region)
    fitted = "; E was then fitted to the known intrinsics"
    proven = choice.config is Configuration.UNCALIBRATED
    if proven or covariance.translation_sigma_deg < c.KNOWN_DEG:
        return EstimatedPose(cam2_from_cam1=pose, covariance=covariance, sentence=fitted, E=pose.essential)
    off = mean - pose.rotation_vector
    unseen = c.UNSEEN * float(np.median(likelihood.matches.length_px)) / likelihood.unit_px
    spread = region.matrix[:3, :3] - np.outer(off, off) + unseen**2 * np.eye(3)
    alone = rotation_alone(mean, spread, "the mean rotation over all directions of translation")
    if not choice.reports_F:
        return alone
    return replace(alone, E=pose.essential, sentence=f"{fitted}{alone.sentence}")


def fit_calibrated(
    likelihood: Likelihood, start: CameraF, directions: DirectionLikelihood
) -> tuple[CameraF, RigidTransform]:
    """Return the cheapest E, from a camera's fit or the likeliest direction of translation, and its pose."""
    ((rotation, t),) = directions.likeliest(1)
    likeliest = CameraF(t=t, R=rotation_matrix(rotation), sigma=likelihood.prior)
    point = fit_best([start, likeliest], likelihood).point
    residuals = likelihood.residuals(point.matrix())
    inliers = residuals.weights.sum(axis=0)
    return point, pose_before_both(point.matrix(), likelihood.ends, residuals.forward_share, inliers)


def region_of(likelihood: DirectionLikelihood, pose: RigidTransform) -> tuple[Array, PoseCovariance]:
    """Return the mean rotation vector (3,) over all directions, and the covariance about a pose."""
    directions, rotations, costs, orders = likelihood.grid
    weight = np.exp(-0.5 * (costs - costs.min()))
    weight /= weight.sum()
    *_, (order,) = likelihood.at(pose.translation[None])
    sign = np.where(orders @ order < 0, -1.0, 1.0)[:, None]  # of two flips of time, that of the pose
    tangents = plane_basis(pose.translation)
    offset = sign * directions @ tangents.T
    angle = np.arccos(np.clip(sign[:, 0] * (directions @ pose.translation), -1.0, 1.0))
    offset *= (angle / np.maximum(np.linalg.norm(offset, axis=1), TINY))[:, None]
    both = np.concatenate([sign * rotations - pose.rotation_vector, offset], axis=1)
    matrix = (both * weight[:, None]).T @ both
    matrix[3:, 3:] += np.radians(c.GRID_STEP_DEG) ** 2 / 12 * np.eye(2)
    return weight @ (sign * rotations), PoseCovariance(matrix=matrix, tangents=tangents)


def covariance_of(
    correlated: Likelihood, point: CameraF, pose: RigidTransform, directions: PoseCovariance
) -> PoseCovariance:
    """Return the covariance of the pose of E at a point, of that over all ``directions`` about it.

    It is the inverse of Gauss and Newton's normal matrix, times a factor as that leaves out that orders and
    outliers are uncertain, and, where few smears are independent, the spread of the likelihood over the
    directions; where many are that is narrower than its grid.
    """
    normal, _ = FundamentalFit.likelier(point, correlated).normal_equations()
    matrix = c.MISSED * np.linalg.pinv(normal[np.ix_(POSE, POSE)], hermitian=True)
    tangents = np.copysign(1.0, pose.translation @ point.t) * plane_basis(point.t)
    if not correlated.has_many_independent:
        step = np.eye(5)
        step[3:, 3:] = tangents @ directions.tangents.T
        matrix = matrix + step @ directions.matrix @ step.T
    return PoseCovariance(matrix=np.asarray(matrix, float), tangents=tangents)


def rotation_alone(vector: Array, covariance: Array, why: str) -> EstimatedPose:
    """Return the pose of a rotation vector (3,), in radians, of covariance (3, 3), without a translation."""
    matrix = np.diag([0.0, 0.0, 0.0, ANY_DIRECTION, ANY_DIRECTION])
    matrix[:3, :3] = covariance
    return EstimatedPose(
        cam2_from_cam1=RigidTransform(rotation=cayley(cross_matrix(vector)), translation=np.zeros(3)),
        covariance=PoseCovariance(matrix=matrix, tangents=np.eye(3)[:2]),
        sentence=f"; the pose is {why}",
        E=None,
    )
