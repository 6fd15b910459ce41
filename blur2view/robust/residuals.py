"""Residuals of smears in both orders, the odds of the orders, and how a family is fitted to them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.robust.calibration import DEPTH_TRUST


@dataclass(frozen=True, kw_only=True)
class RefineOptions:
    """How `refine` works.

    ``max_iterations`` steps at most; ``effective_share`` the share of independent matches, which tempers the
    data against the prior; ``tolerance`` the relative decrease of the cost that ends the search, ``rest`` the
    step in standard deviations of the parameters that does; ``decided`` takes each match's better order for
    granted (see `OrderedResiduals`).
    """

    max_iterations: int = 20
    effective_share: float = 1.0
    tolerance: float = 1e-5
    rest: float = 0.0
    decided: bool = False

    @property
    def depth_weight(self) -> float:
        """Weight of positive depth's odds of the orders, in (0, 1).

        Errors that neighbours share mislead about depth as they do about F: on network smears of rendered
        photographs, of which one in thirty is independent, the median rho was 0.049 with full odds, 0.039 so.
        """
        return 1 / (1 + (DEPTH_TRUST / self.effective_share) ** 3)

    def __post_init__(self) -> None:
        if self.max_iterations < 0 or not 0 < self.effective_share <= 1:
            raise ValueError(f"need max_iterations >= 0, 0 < effective_share <= 1, got {self}")


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
