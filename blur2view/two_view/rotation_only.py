"""The rotation that explains smears without any translation, and how far it can be trusted.

Where parallax is not proven nothing tells a translation, and a fit with one takes what errors or the rotation
leave for it. Lengths err more than directions, so a smear's deviation counts by its component.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.pose import PoseCovariance, RigidTransform
from blur2view.geometry.rotation import half_sphere, rotation_flow, rotation_matrix
from blur2view.robust.independence import ALIKE, block_scatter, slow_errors
from blur2view.robust.problem import LENGTH_ERROR, SmearProblem
from blur2view.robust.reweighted import reweighted_motion

ROUGH_COUNT = 500  # smears, at least, that starts are sought and tried on
STEPS, AXES = 12, 13  # of reweighting, from so many axes
ERROR = 0.25  # share of its length by which a smear misses its rotation at half its weight
CUTOFF = 2.0  # the same of the refined rotation, in standard deviations
# Of the slow errors that the standard deviations admit, as met: of 21 development rotations, smears of the
# network (`tools.datasets.motion_kinds`) the region of 90 % held 20; with all of them it was two to three
# times as wide as the errors.
SLOW_SHARE = 0.5
UNSEEN = 0.5  # deviation of a coordinate of a point that lies anywhere on a disc of radius 1
ANY_DIRECTION = (np.pi - 2) / 2  # squared radians: variance of an axis of any direction along each tangent


def rotation_alone(problem: SmearProblem) -> Array:
    """Return the rotation vector (3,) that explains most smears without translation; up to sign."""
    part = problem.subset(slice(None, None, max(1, len(problem.ends) // ROUGH_COUNT)))
    d = (part.ends[:, 1] - part.ends[:, 0]).T  # (2, N)
    length = np.maximum(np.linalg.norm(d, axis=0), TINY)
    rows = np.swapaxes(rotation_flow(part.ends.mean(axis=1)) / length, 0, 1)  # (3, 2, N)
    starts = half_sphere(AXES)
    every = np.broadcast_to(rows, (AXES, *rows.shape)), np.broadcast_to(d / length, (AXES, *d.shape))
    rotations, missed = reweighted_motion(
        *every, steps=STEPS, scale=lambda _: ERROR, start=starts, ordered=False
    )
    return np.asarray(rotations[int(np.argmin((missed**2 / (missed**2 + ERROR**2)).sum(axis=1)))])


@dataclass(frozen=True, kw_only=True, eq=False)
class RotationFit:
    """A rotation among its smears, whose errors are in standard deviations along and across them.

    Parameters
    ----------
    problem : SmearProblem
        Smears in coordinates of the camera (K = identity), its intrinsics known.
    """

    problem: SmearProblem

    @cached_property
    def frames(self) -> Array:
        """Unit vectors along and across each smear over their standard deviations, (2, 2, N)."""
        d = (self.problem.ends[:, 1] - self.problem.ends[:, 0]).T
        length = np.maximum(np.linalg.norm(d, axis=0), TINY)
        along, across = d / length, np.stack([-d[1], d[0]]) / length
        sigma = 2**0.5 * self.problem.sigma_px / self.problem.unit_px
        return np.stack([along / np.hypot(sigma, LENGTH_ERROR * length), across / sigma])

    @cached_property
    def rows(self) -> Array:
        """Flow (3, 2, N) along and across the smears per radian of rotation, in standard deviations."""
        flow = rotation_flow(self.problem.ends.mean(axis=1))  # (2, 3, N)
        rows: Array = np.einsum("fdn,dkn->kfn", self.frames, flow)
        return rows

    @cached_property
    def measured(self) -> Array:
        """The smears (2, N) in the same components."""
        d = self.problem.ends[:, 1] - self.problem.ends[:, 0]
        measured: Array = np.einsum("fdn,nd->fn", self.frames, d)
        return measured

    @cached_property
    def vector(self) -> Array:
        """The rotation vector (3,), radians; up to sign."""
        return reweighted_motion(
            self.rows,
            self.measured,
            steps=STEPS,
            scale=lambda _: CUTOFF,
            start=rotation_alone(self.problem),
            ordered=False,
        )[0]

    def ordered_by(self, swapped: NDArray[np.bool_]) -> Array:
        """Return the rotation vector (3,) of the flip of time in which ends[:, 1] is open where swapped."""
        predicted = np.einsum("k,kfn->fn", self.vector, self.rows)
        agreement = np.where(swapped, -1.0, 1.0) * (predicted * self.measured).sum(axis=0)
        return self.vector if np.sign(agreement).sum() >= 0 else -self.vector

    @cached_property
    def covariance(self) -> Array:
        """Covariance (3, 3) of the rotation vector, radians squared, if there is no translation."""
        predicted = np.einsum("k,kfn->fn", self.vector, self.rows)
        sign = np.where((predicted * self.measured).sum(axis=0) < 0, -1.0, 1.0)
        residual = predicted - sign * self.measured
        weight = 1 / (CUTOFF**2 + (residual**2).sum(axis=0))
        gradient = (self.rows * residual * weight).sum(axis=1)  # (3, N)
        scatter = block_scatter(gradient, self.problem.ends.mean(axis=1))
        if self.problem.data_weight < ALIKE:
            errors = np.einsum("fdn,mnd->mfn", self.frames, slow_errors(self.problem))
            slow = SLOW_SHARE * np.einsum("kfn,mfn->km", self.rows * weight, sign * errors)
            scatter += slow @ slow.T
        bent = (CUTOFF * weight) ** 2  # of Cauchy's cost, a mean over the directions of the residual
        inverse = np.linalg.pinv(np.einsum("kfn,lfn,n->kl", self.rows, self.rows, bent), hermitian=True)
        covariance: Array = inverse @ scatter @ inverse
        return covariance

    def pose(self, swapped: NDArray[np.bool_], translates: bool) -> tuple[RigidTransform, PoseCovariance]:
        """Return the pose without translation, and its covariance.

        Parameters
        ----------
        swapped : ndarray of bool, shape (N,)
            Where ends[:, 1] is the open end.
        translates : bool
            Whether the camera may have moved: then a translation past things at one depth, or on a slope, may
            account for any part of the smears, and the rotation is as uncertain. Its direction is unknown.
        """
        matrix = np.diag([0.0, 0.0, 0.0, ANY_DIRECTION, ANY_DIRECTION])
        matrix[:3, :3] = self.covariance
        if translates:
            unseen = UNSEEN * float(np.median(self.problem.length_px)) / self.problem.unit_px
            matrix[:3, :3] += unseen**2 * np.eye(3)
        pose = RigidTransform(rotation=rotation_matrix(self.ordered_by(swapped)), translation=np.zeros(3))
        return pose, PoseCovariance(matrix=matrix, tangents=np.eye(3)[:2])
