"""Residuals of smears in both orders, and the odds of the orders."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderedResiduals:
    """Residuals of every smear in both orders, in standard deviations, and the odds of its order.

    ``both`` (2, N) are the residuals of ends[:, 0] first and of ends[:, 1] first; ``prior`` both orders'
    probabilities before looking at the residuals: 1/2, or (2, N) by positive depth (`depth`). At even odds,
    deciding an order costs 2 log 2 and is only worth it where the orders differ by more than the noise.
    ``parts`` are what their derivatives take: those of `sampson.residual_parts`.
    """

    both: Array
    prior: Array | float = 0.5
    parts: tuple[Array, ...] = ()

    @cached_property
    def swapped(self) -> NDArray[np.bool_]:
        """Whether ends[:, 1] first is the better order, (N,)."""
        return np.asarray(np.abs(self.both[1]) < np.abs(self.both[0]))

    @cached_property
    def least(self) -> Array:
        """Residuals (N,) of the better order, signed."""
        return np.asarray(np.where(self.swapped, self.both[1], self.both[0]))

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
        return replace(self, prior=np.stack([~self.swapped, self.swapped]).astype(float))
