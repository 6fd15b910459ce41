"""The likelihood of every direction of translation, on a grid over half a sphere.

Given a direction every smear's epipolar line and order follow (a point before the camera moves away from the
epipole, or to it), and the rotation that brings most smears onto their lines follows linearly. Smears of a
turning camera leave it flat, which no covariance about one optimum shows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import unit_lines
from blur2view.geometry.pose import PoseCovariance, RigidTransform
from blur2view.geometry.rotation import half_sphere, plane_basis, rotation_flow
from blur2view.two_view import constants as c
from blur2view.two_view.least_squares import reweighted_motion
from blur2view.two_view.likelihood import Likelihood


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
        outwards = np.where(along[:, 0] * unit[0] + along[:, 1] * unit[1] >= 0, 1.0, -1.0)
        wanted = outwards * (across[:, 0] * unit[0] + across[:, 1] * unit[1])  # (G, N)
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
        parts = [self.at(some) for some in np.array_split(directions, c.GRID_PARTS)]
        rotations, costs, orders = (np.concatenate(part) for part in zip(*parts, strict=True))
        return directions, rotations, costs, orders

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
