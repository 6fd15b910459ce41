"""Residuals of smears in both orders, and the odds of the orders.

Many F are tried on the same smears, so whatever is a product of coordinates is computed once (`EndProducts`):
what is left of an F is two products of matrices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import homogeneous
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
class EndProducts:
    """Products of the coordinates of ends: Sampson distances are made of what is linear in them.

    With x = ends[:, 0] and y = ends[:, 1], homogeneous: ``bilinear`` are the entries of y x^T, which F's own
    multiply to y^T F x; ``squares`` those of x x^T, then of y y^T, which the entries of R^T R and C C^T
    multiply to |(F x)_12|^2 + |(F^T y)_12|^2; R are the first two rows of F, C its first two columns.
    Exchanging the ends is transposing F.
    """

    bilinear: Array  # (9, N)
    squares: Array  # (18, N)

    @classmethod
    def of(cls, ends: Array, sigma: Array | float = 1.0) -> EndProducts:
        """Return those of ends (N, 2, 2); distances are then in standard deviations sigma (N,)."""
        x, y = np.ascontiguousarray(homogeneous(ends).transpose(1, 2, 0))  # (3, N) each
        yx, xx, yy = ((a[:, None] * b).reshape(9, -1) for a, b in ((y, x), (x, x), (y, y)))
        return cls(bilinear=yx / sigma, squares=np.concatenate([xx, yy]))

    def distances(self, F: Array) -> tuple[Array, Array]:
        """Return signed Sampson distances (2, N) of F (3, 3) and F^T, and lengths (2, N) of their gradients.

        References
        ----------
        Hartley and Zisserman, Multiple View Geometry, 2nd ed., equation 11.9.
        """
        root = np.sqrt(np.maximum(gradient_entries(F, F[None])[0] @ self.squares, TINY))
        return np.stack([F, F.T]).reshape(2, 9) @ self.bilinear / root, root

    def derivatives(self, F: Array, tangents: Array, distance: Array, root: Array | float) -> Array:
        """Return how these distances of F change (k, 2, N) along tangents (k, 3, 3)."""
        both = np.stack([tangents, np.swapaxes(tangents, 1, 2)], axis=1)
        change = (both.reshape(-1, 9) @ self.bilinear).reshape(len(tangents), 2, -1)
        gradient = (gradient_entries(F, tangents).reshape(-1, 18) @ self.squares).reshape(change.shape)
        gradient *= distance / root
        change -= gradient
        change /= root
        return np.asarray(change)


def gradient_entries(F: Array, tangents: Array) -> Array:
    """Return what multiplies squares to half the squared gradients' derivatives (k, 2, 18), of F and F^T."""
    of_x = (F[:2].T @ tangents[:, :2]).reshape(-1, 9)
    of_y = (F[:, :2] @ np.swapaxes(tangents[:, :, :2], 1, 2)).reshape(-1, 9)
    return np.concatenate([of_x, of_y, of_y, of_x], axis=1).reshape(-1, 2, 18)


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
