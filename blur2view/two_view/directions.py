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

LEAST_LENGTH = np.float32(1e-6)  # of a smear over the focal length: shorter ones have no direction


@dataclass(frozen=True, kw_only=True, eq=False)
class DirectionLikelihood:
    """Smears of a camera (K = identity) under any direction of translation; all their correlation counts."""

    likelihood: Likelihood

    def at(self, directions: Array) -> tuple[Array, Array, Array]:
        """Return rotation vectors (G, 3) of directions (G, 3), their costs (G,), and orders of smears (G, N).

        Costs are twice the negative log-posteriors; an order is 1 where ends[:, 0] is the open end, else -1.
        """
        some = self.likelihood.thinned(c.GRID_SMEARS)
        middle, displacement = (one.astype(np.float32) for one in (some.middle, some.displacement))
        length = np.maximum(np.hypot(*displacement.T), LEAST_LENGTH)
        unit, flow = displacement.T / length, rotation_flow(middle) / length
        along, across = unit_lines(directions.astype(np.float32), middle)  # (G, 2, N)
        rows = across[:, 0, None] * flow[0] + across[:, 1, None] * flow[1]  # (G, 3, N)
        outwards = np.copysign(np.float32(1), along[:, 0] * unit[0] + along[:, 1] * unit[1])
        wanted = outwards * (across[:, 0] * unit[0] + across[:, 1] * unit[1])  # (G, N)
        own = some.sigma_scale * some.matches.inlier_sigma_px[1] / (length * some.unit_px)
        share = np.hypot(own, some.matches.shared.least).astype(np.float32)  # error across over length
        rotations, missed = reweighted_motion(
            rows[:, :, None], wanted[:, None], steps=c.GRID_STEPS, scale=lambda _: share
        )
        data = (c.FREEDOM + 1) * np.log1p((missed / share) ** 2 / c.FREEDOM).mean(axis=1, dtype=float)
        prior = ((rotations / (c.GRID_ROTATION_SPREAD * float(np.median(length)))) ** 2).sum(axis=1)
        return rotations.astype(float), self.likelihood.effective_count * data + prior, outwards

    @cached_property
    def grid(self) -> tuple[Array, Array, Array, Array]:
        """Directions (G, 3), their rotations (G, 3), costs (G,) and orders of smears (G, N)."""
        directions = half_sphere(c.GRID)
        parts = [self.at(some) for some in np.array_split(directions, c.GRID_PARTS)]
        rotations, costs, orders = (np.concatenate(part) for part in zip(*parts, strict=True))
        return directions, rotations, costs, orders

    def likeliest(self, count: int) -> list[tuple[Array, Array]]:
        """Return rotation vectors and translations (3,) of the greatest likelihood, no two close together."""
        directions, rotations, costs, _ = self.grid
        kept: list[int] = []
        for one in np.argsort(costs):
            if len(kept) < count and (np.abs(directions[kept] @ directions[one]) < c.GRID_APART).all():
                kept.append(int(one))
        return [(rotations[one], directions[one]) for one in kept]

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
