"""Residuals of smears in both orders, and the odds of the orders by residuals and by positive depth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.rotation import rotation_flow

PROBIT_AS_LOGIT = 1.702  # log(Phi(z)) is -log(1 + exp(-1.702 z)) to within 0.01 in Phi
MOST_LOG_ODDS = 300.0  # against an order: two such make no number that is too small


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderedResiduals:
    """Residuals of every smear in both orders, in standard deviations, and the odds of its order.

    ``both`` (2, N) are the residuals of ends[:, 0] first and of ends[:, 1] first; ``prior`` both orders'
    probabilities before looking at the residuals: 1/2, or (2, N) by positive depth (`DepthOdds`). At even
    odds, deciding an order costs 2 log 2 and is only worth it where the orders differ by more than the noise.
    ``root`` (2, N) is the gradient's length, which their derivatives take.
    """

    both: Array
    prior: Array | float = 0.5
    root: Array | float = 1.0

    @cached_property
    def backward(self) -> NDArray[np.bool_]:
        """Whether ends[:, 1] first is the better order, (N,)."""
        return np.asarray(np.abs(self.both[1]) < np.abs(self.both[0]))

    @cached_property
    def least(self) -> Array:
        """Residuals (N,) of the better order, signed."""
        return np.asarray(np.where(self.backward, self.both[1], self.both[0]))

    @cached_property
    def likelihoods(self) -> Array:
        """Probability times likelihood (2, N) of both orders; their sum is at most 1."""
        return np.asarray(np.exp(-0.5 * self.both**2) * self.prior)

    @property
    def forward_share(self) -> Array:
        """Posterior probability (N,) of the order ends[:, 0] first."""
        ahead, behind = np.log(self.prior) - 0.5 * self.both**2
        share: Array = 0.5 * (1 + np.tanh(0.5 * (ahead - behind)))
        return share

    def decided(self) -> OrderedResiduals:
        """Return them with each smear's better order taken for granted, as SErrMin does."""
        return replace(self, prior=np.stack([~self.backward, self.backward]).astype(float))


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthOdds:
    """The order of a smear by positive depth (cheirality), read before any order is known; K = identity.

    A point in front of the camera moves, once the rotation is taken off, away from the epipole of a camera
    that goes forward and towards that of one that goes back. So a motion decides of every smear which of its
    two orders such a point can have: where the translation moves points farther along their epipolar lines
    than the rotation does, exactly one. Motions are along t_12 - t_3 p, linear in t at a midpoint p:
    ``moved`` is what t multiplies to that of the smear, ``turned`` what t w^T multiplies to that of a
    rotation w, to first order: cameras rotate by a few degrees at most.
    """

    middle: Array  # (2, N)
    moved: Array  # (3, N)
    turned: Array  # (9, N)
    along: Array  # (N,) standard deviations of displacements along epipolar lines

    @classmethod
    def of(cls, middle: Array, displacement: Array, along: Array) -> DepthOdds:
        """Return those of midpoints, and of displacements ends[:, 1] - ends[:, 0], (N, 2)."""
        flow = np.concatenate([displacement.T[:, None], rotation_flow(middle)], axis=1)  # (2, 4, N)
        lines = np.concatenate([flow, -(middle.T[:, None] * flow).sum(axis=0, keepdims=True)])  # (3, 4, N)
        turned, middle = lines[:, 1:].reshape(9, -1), np.ascontiguousarray(middle.T)
        return cls(middle=middle, moved=lines[:, 0], turned=turned, along=along)

    def at(self, rotation: Array, t: Array, sign: float) -> Array:
        """Return probabilities (2, N) of ends[:, 0] first and ends[:, 1] first, of a motion (w, +-t).

        An order is as probable as its parallax is positive. Where both are feasible they share, so that a
        motion gains nothing by being vague; where none is, both are improbable.
        """
        moved, turned = t @ self.moved, np.outer(t, rotation).reshape(-1) @ self.turned
        x, y = self.middle
        length = np.sqrt((t[0] - t[2] * x) ** 2 + (t[1] - t[2] * y) ** 2) + TINY
        against = np.stack([turned - moved, turned + moved]) * (
            sign * PROBIT_AS_LOGIT / (length * self.along)
        )
        feasible = 1 / (1 + np.exp(np.minimum(against, MOST_LOG_ODDS)))
        return np.asarray(feasible * (np.maximum(*feasible) / np.add(*feasible)))
