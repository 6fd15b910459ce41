"""Residuals of smears in both orders, and their weights: standard deviations, outliers, depth, neighbours."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.geometry.depth import order_log_odds
from blur2view.geometry.epipolar import homogeneous
from blur2view.geometry.sampson import residual_parts

CUTOFF = 3.0
"""Residual, in standard deviations, at which a smear is as likely an outlier as an inlier."""
NEGLIGIBLE = 1e-4  # probability below which an order of a smear is left out of the normal equations
LOG_2 = math.log(2.0)
DEPTH_TRUST = 0.25  # share of independent smears at which depth's odds count half


@dataclass(frozen=True, kw_only=True)
class RefineOptions:
    """How `refine` works.

    ``max_iterations`` steps at most; ``data_weight`` the share of independent matches (effective over actual
    number), which tempers the data against the prior; ``tolerance`` the relative decrease of the cost that
    ends the search, ``rest`` the step in standard deviations of the parameters that does; ``decided`` takes
    each match's better order for granted (see `OrderedResiduals`).
    """

    max_iterations: int = 20
    data_weight: float = 1.0
    tolerance: float = 1e-5
    rest: float = 0.0
    decided: bool = False

    @property
    def depth_weight(self) -> float:
        """Weight of positive depth's odds of the orders, in (0, 1).

        Errors that neighbours share mislead about depth as they do about F: on network smears of rendered
        photographs, of which one in thirty is independent, the median rho was 0.049 with full odds, 0.039 so.
        """
        return 1 / (1 + (DEPTH_TRUST / self.data_weight) ** 3)

    def __post_init__(self) -> None:
        if self.max_iterations < 0 or not 0 < self.data_weight <= 1:
            raise ValueError(f"need max_iterations >= 0, 0 < data_weight <= 1, got {self}")


@dataclass(frozen=True, kw_only=True)
class OrderedResiduals:
    """Residuals of every smear in both orders, in standard deviations, and the odds of its order.

    ``both`` (2, N) are the residuals of ends[:, 0] first and of ends[:, 1] first; ``prior`` both orders'
    probabilities before looking at the residuals: 1/2, or (2, N) by positive depth (`depth`). Twice the
    negative log-likelihood of a smear is -2 log(P(0) exp(-both[0]^2 / 2) + P(1) exp(-both[1]^2 / 2)): at even
    odds, deciding an order costs 2 log 2 and is only worth it where the orders differ by more than the noise.
    ``decided`` takes the better order for granted instead, as SErrMin does: right for a search at unknown
    noise, but it rewards any S as large as the noise (on pure translations with 4 degrees of noise median rho
    0.022 against 0.010). ``parts`` are what their derivatives take: those of `sampson.residual_parts`.
    """

    both: Array
    prior: Array | float = 0.5
    decided: bool = False
    parts: tuple[Array, ...] = ()

    @cached_property
    def swapped(self) -> NDArray[np.bool_]:
        """Whether ends[:, 1] first is the better order, (N,)."""
        forward, backward = np.abs(self.both)
        return np.asarray(backward < forward)

    @cached_property
    def likelihoods(self) -> Array:
        """Probability times likelihood (2, N) of both orders; of decided ones that of the worse is zero."""
        gaussian: Array = np.exp(-0.5 * self.both**2)
        return gaussian * (np.stack([~self.swapped, self.swapped]) if self.decided else self.prior)

    @cached_property
    def total(self) -> Array:
        """Likelihood (N,) of the smears, both orders together; at most 1."""
        total: Array = np.add(*self.likelihoods)
        return total

    @cached_property
    def least(self) -> Array:
        """Residuals (N,) of the better order, signed."""
        forward, backward = self.both
        return np.asarray(np.where(self.swapped, backward, forward))

    @cached_property
    def forward_share(self) -> Array:
        """Posterior probability (N,) of the order ends[:, 0] first."""
        if self.decided:
            return (~self.swapped).astype(float)
        ahead, behind = np.log(self.prior) - 0.5 * self.both**2
        share: Array = 0.5 * (1 + np.tanh(0.5 * (ahead - behind)))
        return share


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightedEnds:
    """Smears in a manifold's coordinates, and what is known of their errors; all arrays of shape (N,).

    ``sigma`` is the standard deviation of the Sampson distance. ``chance`` is the density of an outlier's
    residual over that of an inlier at zero, times the odds of being one (default: half an inlier at CUTOFF).
    ``along`` is the standard deviation of a displacement's component along its epipolar line; where it is
    given, positive depth gives odds of the orders, in coordinates with K near the identity.
    """

    ends: Array  # (N, 2, 2)
    sigma: Array
    along: Array | None = None
    chance: Array | float = math.exp(-0.5 * CUTOFF**2)

    @cached_property
    def orders(self) -> tuple[Array, Array, Array]:
        """Homogeneous points of both views (3, 2 N), in one order and the other, and sigma (2 N,)."""
        one, other = (homogeneous(self.ends[:, i]).T for i in (0, 1))
        first, second = np.concatenate([one, other], axis=1), np.concatenate([other, one], axis=1)
        return first, second, np.concatenate([self.sigma, self.sigma])

    @cached_property
    def middle(self) -> tuple[Array, Array]:
        """Midpoints and displacements ends[:, 1] - ends[:, 0], (2, N)."""
        one, other = self.ends[:, 0].T, self.ends[:, 1].T
        return 0.5 * (one + other), other - one

    def residuals(self, F: Array, decided: bool = False, prior: Array | float = 0.5) -> OrderedResiduals:
        """Return residuals under F (3, 3) in both orders, of which ``prior`` are the probabilities before."""
        first, second, sigma = self.orders
        parts = residual_parts(F, first, second)
        both = (parts[0] / sigma).reshape(2, -1)
        return OrderedResiduals(both=both, prior=prior, decided=decided, parts=parts)

    def weigh(self, plain: OrderedResiduals, parallax: Array, weight: float) -> OrderedResiduals:
        """Return residuals with the odds of the orders by positive depth, of `parallax_along_lines` (2, N).

        ``weight`` in [0, 1] tempers the odds. Nothing changes without ``along``.
        """
        if self.along is None:
            return plain
        odds = order_log_odds(parallax, self.along)
        return replace(plain, prior=np.exp(weight * odds + (weight - 1) * LOG_2))

    def costs(self, residuals: OrderedResiduals) -> Array:
        """Return twice the negative log-likelihood (N,) of the mixture, 0 for a perfect inlier."""
        cost: Array = -2 * np.log((residuals.total + self.chance) / (1 + self.chance))
        return cost

    def order_weights(self, residuals: OrderedResiduals) -> Array:
        """Return probabilities (2, N) of being an inlier in either order: weights of least squares."""
        weights: Array = residuals.likelihoods / (residuals.total + self.chance)
        return weights


def robust_weight(squared: Array) -> Array:
    """Return Geman and McClure's weights (1 + c / CUTOFF^2)^-2 of squared residuals c."""
    weight: Array = 1 / (1 + squared / CUTOFF**2) ** 2
    return weight
