"""Residuals of smears in both orders, and their weights: standard deviations, outliers, depth, neighbours."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.depth import order_log_odds, parallax_along_lines
from blur2view.geometry.epipolar import homogeneous
from blur2view.geometry.sampson import residual_parts
from blur2view.robust.parametrization import Manifold
from blur2view.smears.sign_components import SignComponents

LOG_2 = float(np.log(2.0))
VOTE, MAJORITY = 3.0, 4.0  # most that one smear, and its whole component, weigh on an order: log-odds
DEPTH_TRUST = 0.25  # share of independent smears at which depth's odds count half


@dataclass(frozen=True, kw_only=True)
class RefineOptions:
    """How `refine` works.

    ``max_iterations`` steps at most; ``cutoff`` the residual, in standard deviations, at which a match is as
    likely an outlier as an inlier, unless the matches know more (`WeightedEnds.chance`); ``data_weight`` the
    share of independent matches (effective over actual number), which tempers the data against the prior;
    ``tolerance`` the relative decrease of the cost that ends the search, ``rest`` the step in standard
    deviations of the parameters that does; ``decided`` takes each match's better order for granted (see
    `OrderedResiduals`).
    """

    max_iterations: int = 20
    cutoff: float = 3.0
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
        """Refuse options out of range."""
        if self.max_iterations < 0 or not self.cutoff > 0 or not 0 < self.data_weight <= 1:
            raise ValueError(f"need max_iterations >= 0, cutoff > 0, 0 < data_weight <= 1, got {self}")


@dataclass(frozen=True, kw_only=True)
class OrderedResiduals:
    """Residuals of every smear in both orders, in standard deviations, and the odds of its order.

    ``forward`` and ``backward`` (N,) are the residuals of ends[:, 0] first and ends[:, 1] first;
    ``forward_log`` and ``backward_log`` the logarithms of both orders' probabilities before looking at the
    residuals: log(1/2), or by positive depth (`depth`). Twice the negative log-likelihood of a smear
    is -2 log(P(f) exp(-forward^2 / 2) + P(b) exp(-backward^2 / 2)): at even odds, deciding an order costs
    2 log 2 and is only worth it where the orders differ by more than the noise. ``decided`` takes the better
    order for granted instead, as SErrMin does: right for a search at unknown noise, but it rewards any S as
    large as the noise (on pure translations with 4 degrees of noise median rho 0.022 against 0.010).
    ``parts`` are what their derivatives take: those of `sampson.residual_parts`.
    """

    forward: Array
    backward: Array
    forward_log: Array | float = -LOG_2
    backward_log: Array | float = -LOG_2
    decided: bool = False
    parts: tuple[Array, Array, Array, Array] | None = None

    @cached_property
    def likelihoods(self) -> Array:
        """Probability times likelihood (2, N) of both orders; of decided ones that of the worse is zero."""
        ahead, behind = np.exp(-0.5 * self.forward**2), np.exp(-0.5 * self.backward**2)
        if self.decided:
            first = np.abs(self.forward) <= np.abs(self.backward)
            return np.stack([ahead * first, behind * ~first])
        return np.stack([ahead * np.exp(self.forward_log), behind * np.exp(self.backward_log)])

    @cached_property
    def total(self) -> Array:
        """Likelihood (N,) of the smears, both orders together; a component's odds may take it over 1."""
        total: Array = self.likelihoods.sum(axis=0)
        return total

    @cached_property
    def least(self) -> Array:
        """Residuals (N,) of the better order, signed."""
        return np.where(np.abs(self.backward) < np.abs(self.forward), self.backward, self.forward)

    @cached_property
    def log_likelihoods(self) -> tuple[Array, Array]:
        """Logarithms (N,) of probability times likelihood, of both orders."""
        ahead: Array = self.forward_log - 0.5 * self.forward**2
        behind: Array = self.backward_log - 0.5 * self.backward**2
        return ahead, behind

    @cached_property
    def forward_share(self) -> Array:
        """Posterior probability (N,) of the order ends[:, 0] first."""
        if self.decided:
            return (np.abs(self.forward) <= np.abs(self.backward)).astype(float)
        ahead, behind = self.log_likelihoods
        share: Array = 0.5 * (1 + np.tanh(0.5 * (ahead - behind)))
        return share

    @cached_property
    def squared(self) -> Array:
        """Twice the negative log-likelihood (N,), without the Gaussian's constant; not negative."""
        if self.decided:
            return self.least**2
        soft: Array = np.maximum(-2 * np.logaddexp(*self.log_likelihoods), 0.0)
        return soft


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightedEnds:
    """Smears in a manifold's coordinates, and what is known of their errors; all arrays of shape (N,).

    ``sigma`` is the standard deviation of the Sampson distance. ``chance`` is the density of an outlier's
    residual over that of an inlier at zero, times the odds of being one (default: half an inlier at the
    options' cutoff). ``along`` is the standard deviation of a displacement's component along its epipolar
    line; where it is given, positive depth gives odds of the orders, in coordinates with K near the identity.
    """

    ends: Array  # (N, 2, 2)
    sigma: Array
    along: Array | None = None
    chance: Array | None = None
    components: SignComponents | None = None

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

    def residuals(
        self, F: Array, decided: bool = False, logs: tuple[Array | float, Array | float] = (-LOG_2, -LOG_2)
    ) -> OrderedResiduals:
        """Return residuals under F (3, 3) in both orders, equally likely before or as ``logs`` have it."""
        first, second, sigma = self.orders
        parts = residual_parts(F, first, second)
        forward, backward = (parts[0] / sigma).reshape(2, -1)
        return OrderedResiduals(
            forward=forward,
            backward=backward,
            forward_log=logs[0],
            backward_log=logs[1],
            decided=decided,
            parts=parts,
        )

    def weigh(self, plain: OrderedResiduals, point: Manifold, weight: float, sign: float) -> OrderedResiduals:
        """Return residuals with the odds of the orders by positive depth, under a point of a family.

        ``sign`` is that of the point's translation; ``weight`` in [0, 1] tempers the odds. Nothing changes
        without ``along``.
        """
        if self.along is None:
            return plain
        rotation, t = point.motion()
        both = parallax_along_lines(rotation, sign * t, *self.middle)
        odds = order_log_odds(*both, self.along)
        ahead, behind = (weight * log + (weight - 1) * LOG_2 for log in odds)
        if self.components is not None:
            alone = replace(plain, forward_log=ahead, backward_log=behind)
            others = weight * component_log_odds(self.components, alone)
            share = 1 / (1 + np.exp(-others))  # others are bounded; 1/2 without any, which changes nothing
            ahead, behind = ahead + np.log(2 * share), behind + np.log(2 - 2 * share)
        return replace(plain, forward_log=ahead, backward_log=behind)

    def costs(self, residuals: OrderedResiduals, options: RefineOptions) -> Array:
        """Return twice the negative log-likelihood (N,) of the mixture, 0 for a perfect inlier."""
        chance = self._chance(options)
        cost: Array = -2 * np.log((np.minimum(residuals.total, 1.0) + chance) / (1 + chance))
        return cost

    def inlier_shares(self, residuals: OrderedResiduals, options: RefineOptions) -> Array:
        """Return probabilities (N,) of being an inlier: the weights of reweighted least squares."""
        likelihood = np.minimum(residuals.total, 1.0)
        share: Array = likelihood / (likelihood + self._chance(options))
        return share

    def _chance(self, options: RefineOptions) -> Array | float:
        return float(np.exp(-0.5 * options.cutoff**2)) if self.chance is None else self.chance


def component_log_odds(components: SignComponents, residuals: OrderedResiduals) -> Array:
    """Return log-odds (N,) of the order ends[:, 0] first, by the other smears of the component.

    They vote with their own log-odds, bounded; a component whose votes contradict each other has
    none, so a wrong grouping does little harm.
    """
    label, sign = components.label, components.sign
    ahead, behind = residuals.log_likelihoods
    vote = np.clip(ahead - behind, -VOTE, VOTE) * sign
    total, cast = np.bincount(label, vote), np.bincount(label, np.abs(vote))
    unity = np.maximum(2 * np.abs(total) / np.maximum(cast, TINY) - 1, 0.0)
    odds: Array = np.clip(total[label] - vote, -MAJORITY, MAJORITY) * unity[label] * sign
    return odds


def robust_cost(squared: Array, cutoff: float) -> Array:
    """Return Geman-McClure c / (1 + c / cutoff^2) of squared residuals: c when small, cutoff^2 at most."""
    bounded: Array = squared / (1 + squared / cutoff**2)
    return bounded


def robust_weight(squared: Array, cutoff: float) -> Array:
    """Return the derivative (1 + c / cutoff^2)^-2 of `robust_cost`, the weight in least squares."""
    weight: Array = 1 / (1 + squared / cutoff**2) ** 2
    return weight
