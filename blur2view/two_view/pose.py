"""The pose of a camera with known intrinsics: E, the rotation, and the translation where it is known.

Given a direction of translation every smear's epipolar line and order follow (a point before the camera moves
away from the epipole, or to it), and the rotation that brings most smears onto their lines follows linearly.
So the likelihood of every direction of a grid over half a sphere is cheap; smears of a turning camera leave
it flat, which no covariance about one optimum shows. The region counts all correlation of neighbouring smears
(`Likelihood.fully_correlated`).

E has five parameters and is fitted as F is, started from the camera's fit and from the likeliest direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import cross_matrix, unit_lines
from blur2view.geometry.pose import PoseCovariance, RigidTransform
from blur2view.geometry.rotation import half_sphere, plane_basis, rotation_flow, rotation_matrix
from blur2view.geometry.two_view_geometry import Configuration
from blur2view.two_view import constants as c
from blur2view.two_view.choice import Choice
from blur2view.two_view.fit_fundamental import FundamentalFit, fit_best
from blur2view.two_view.fit_homography import fit_homography
from blur2view.two_view.homography import cayley
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import CameraF
from blur2view.two_view.order import pose_before_both
from blur2view.two_view.reweighted import reweighted_motion

POSE = [2, 3, 4, 0, 1]  # a camera's parameters, rotation first
ANY_DIRECTION = (np.pi - 2) / 2  # squared radians: variance of an axis of any direction along each tangent


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatedPose:
    """The pose that is given, how sure it is, and why it is that."""

    cam2_from_cam1: RigidTransform
    covariance: PoseCovariance
    sentence: str
    E: Array | None  # (3, 3) of the intrinsics, which F becomes that of; None where a rotation explains all


@dataclass(frozen=True, kw_only=True, eq=False)
class DirectionLikelihood:
    """Smears of a known camera under any direction of translation."""

    likelihood: Likelihood  # thinned, all correlation counted, in coordinates of the camera (K = identity)
    across: Array  # (N,) standard deviations of the error across each smear over its length
    count: float  # how many of the smears are independent

    @classmethod
    def of(cls, likelihood: Likelihood) -> DirectionLikelihood:
        """Return the smears of a likelihood, thinned; all correlation of neighbours is counted."""
        correlated = likelihood.fully_correlated
        part = correlated.subset(slice(None, None, max(1, len(correlated) // c.GRID_SMEARS)))
        _, across_px = part.matches.inlier_sigma_px
        share = likelihood.sigma_scale * across_px / np.maximum(part.length_px, TINY)
        return cls(
            likelihood=part,
            across=np.hypot(share, part.matches.shared.least),
            count=correlated.effective_count,
        )

    def at(self, directions: Array) -> tuple[Array, Array, Array]:
        """Return rotation vectors (G, 3) of directions (G, 3), their costs (G,), and orders of smears (G, N).

        Costs are twice the negative log-posteriors; an order is 1 where ends[:, 0] is the open end, else -1.
        """
        middle, displacement = self.likelihood.middle, self.likelihood.displacement
        length = np.maximum(np.hypot(*displacement.T), TINY)
        along, across = unit_lines(directions, middle)  # (G, 2, N)
        flow = rotation_flow(middle) / length
        rows = across[:, 0, None] * flow[0] + across[:, 1, None] * flow[1]  # (G, 3, N)
        unit = displacement.T / length
        outwards = np.where((along * unit).sum(axis=1) >= 0, 1.0, -1.0)
        wanted = outwards * (across * unit).sum(axis=1)  # (G, N)
        rotations, missed = reweighted_motion(
            rows[:, :, None], wanted[:, None], steps=c.GRID_STEPS, scale=lambda _: self.across
        )
        data = (c.FREEDOM + 1) * np.log1p((missed / self.across) ** 2 / c.FREEDOM).mean(axis=1)
        spread = c.GRID_ROTATION_SPREAD * float(np.median(length))
        return rotations, self.count * data + ((rotations / spread) ** 2).sum(axis=1), outwards

    @cached_property
    def grid(self) -> tuple[Array, Array, Array, Array]:
        """Directions (G, 3), their rotations (G, 3), costs (G,) and orders of smears (G, N)."""
        directions = half_sphere(c.GRID)
        return (directions, *self.at(directions))

    @cached_property
    def best(self) -> tuple[Array, Array]:
        """Rotation vector and translation (3,) of the greatest likelihood on the grid."""
        directions, rotations, costs, _ = self.grid
        best = int(np.argmin(costs))
        return rotations[best], directions[best]

    def region(self, pose: RigidTransform) -> tuple[Array, PoseCovariance]:
        """Return the mean rotation vector (3,) over all directions, and the covariance about a pose."""
        directions, rotations, costs, orders = self.grid
        weight = np.exp(-0.5 * (costs - costs.min()))
        weight /= weight.sum()
        *_, (order,) = self.at(pose.translation[None])
        sign = np.where(orders @ order < 0, -1.0, 1.0)[:, None]  # of two flips of time, that of the pose
        tangents = plane_basis(pose.translation)
        offset = sign * directions @ tangents.T
        angle = np.arccos(np.clip(sign[:, 0] * (directions @ pose.translation), -1.0, 1.0))
        offset *= (angle / np.maximum(np.linalg.norm(offset, axis=1), TINY))[:, None]
        both = np.concatenate([sign * rotations - pose.rotation_vector, offset], axis=1)
        matrix = (both * weight[:, None]).T @ both
        matrix[3:, 3:] += np.radians(c.GRID_STEP_DEG) ** 2 / 12 * np.eye(2)
        return weight @ (sign * rotations), PoseCovariance(matrix=matrix, tangents=tangents)


def fit_calibrated(
    likelihood: Likelihood, start: CameraF, directions: DirectionLikelihood
) -> tuple[CameraF, RigidTransform]:
    """Return the cheapest E, from a camera's fit or the likeliest direction of translation, and its pose."""
    rotation, t = directions.best
    starts = [start, CameraF(t=t, R=rotation_matrix(rotation), spread=likelihood.prior)]
    fits = [fit_best([start], likelihood) for start in starts]
    point = cast(CameraF, min(fits, key=lambda fit: fit.cost).point)
    residuals = likelihood.residuals(point.matrix())
    inliers = likelihood.order_weights(residuals).sum(axis=0)
    return point, pose_before_both(point.matrix(), likelihood.ends, residuals.forward_share, inliers)


def covariance_of(
    likelihood: Likelihood, point: CameraF, pose: RigidTransform, directions: PoseCovariance
) -> PoseCovariance:
    """Return the covariance of the pose of E at a point, of that over all ``directions`` about it.

    It is the inverse of Gauss and Newton's normal matrix and, where few smears are independent, the spread of
    the likelihood over the directions; where many are that is narrower than its grid, and the curvature, that
    leaves out that orders and outliers are uncertain, is corrected by a factor.
    """
    correlated = likelihood.fully_correlated
    normal, _ = FundamentalFit.likelier(point, correlated).normal_equations()
    matrix = np.asarray(np.linalg.pinv(normal[np.ix_(POSE, POSE)], hermitian=True), np.float64)
    tangents = np.copysign(1.0, pose.translation @ point.t) * plane_basis(point.t)
    if correlated.effective_count >= c.LEAST_INDEPENDENT:
        return PoseCovariance(matrix=c.MISSED * matrix, tangents=tangents)
    step = np.eye(5)
    step[3:, 3:] = tangents @ directions.tangents.T
    return PoseCovariance(matrix=matrix + step @ directions.matrix @ step.T, tangents=tangents)


def estimate_pose(likelihood: Likelihood, choice: Choice) -> EstimatedPose:
    """Return the pose of known intrinsics for a choice with F or H.

    The translation is given where parallax is proven, or its direction known to KNOWN_DEG and no rotation
    explains the smears alone; else the pose is the rotation, whatever the translation.
    """
    if choice.config is Configuration.PANORAMIC and choice.homography is not None:
        fit = fit_homography(choice.homography.family, likelihood.fully_correlated)
        vector, spread = fit.family.parameters[:3], fit.covariance()[:3, :3]
        return rotation_alone(vector, spread, "the rotation that explains the smears alone")
    directions = DirectionLikelihood.of(likelihood)
    point, pose = fit_calibrated(likelihood, cast(CameraF, choice.fit.point), directions)
    mean, region = directions.region(pose)
    covariance = covariance_of(likelihood, point, pose, region)
    fitted = "; E was then fitted to the known intrinsics"
    proven = choice.config is Configuration.UNCALIBRATED
    if proven or covariance.translation_sigma_deg < c.KNOWN_DEG:
        return EstimatedPose(cam2_from_cam1=pose, covariance=covariance, sentence=fitted, E=pose.essential)
    off = mean - pose.rotation_vector
    unseen = c.UNSEEN * float(np.median(likelihood.length_px)) / likelihood.unit_px
    spread = region.matrix[:3, :3] - np.outer(off, off) + unseen**2 * np.eye(3)
    alone = rotation_alone(mean, spread, "the mean rotation over all directions of translation")
    if not choice.reports_F:
        return alone
    return replace(alone, E=pose.essential, sentence=f"{fitted}{alone.sentence}")


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
