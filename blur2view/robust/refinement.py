"""Local optimisation of F: weigh both orders of every match, take a robust Sampson step, repeat."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from blur2view.arrays import Array
from blur2view.robust.likelihood import Likelihood
from blur2view.robust.parametrization import Manifold
from blur2view.robust.residuals import OrderedResiduals


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightedPoint:
    """A point of a family of F with the odds of the smears' orders there: a `levenberg_marquardt.Problem`.

    The order of every smear, and whether it is an outlier, are weighed anew at every point (expectation-
    maximisation), so nothing is ever fixed but the ``sign`` of the translation, by which positive depth
    gives odds to the orders. A sign of 0 takes each smear's better order for granted: right for a search at
    unknown noise, but it rewards any S as large as the noise (on pure translations with 4 degrees of noise
    median rho 0.022 against 0.010). With 30 % outliers and 1 px of noise the mixture of inliers and
    outliers gave an AUC@10 of the pose of 0.83, Geman and McClure's cost 0.72.
    """

    point: Manifold
    likelihood: Likelihood
    sign: float = 0.0

    @classmethod
    def likelier(cls, point: Manifold, likelihood: Likelihood) -> WeightedPoint:
        """Return a point with the sign of the translation that explains more."""
        both = (cls(point=point, likelihood=likelihood, sign=sign) for sign in (1.0, -1.0))
        return min(both, key=lambda state: state.cost)

    @cached_property
    def residuals(self) -> OrderedResiduals:
        """Residuals in both orders, with their odds."""
        plain = self.likelihood.residuals(self.point.matrix())
        if not self.sign:
            return plain.decided()
        return replace(plain, prior=self.likelihood.order_odds(*self.point.motion(), self.sign))

    @cached_property
    def cost(self) -> float:
        """Twice the negative log-posterior."""
        prior, _ = self.point.prior()
        data = self.likelihood.costs(self.residuals).sum()
        return float(self.likelihood.effective_share * data + prior @ prior)

    def normal_equations(self) -> tuple[Array, Array]:
        """Return J^T W J (k, k) and J^T W r (k,) of data, in the orders that count, and prior."""
        weight = np.sqrt(self.likelihood.effective_share * self.likelihood.order_weights(self.residuals))
        jacobian = self.likelihood.derivatives(self.point.matrix(), self.point.tangent(), self.residuals)
        jacobian *= weight
        jacobian = jacobian.reshape(len(jacobian), -1)
        prior, of_prior = self.point.prior()
        gradient = jacobian @ (weight * self.residuals.both).reshape(-1)
        return jacobian @ jacobian.T + of_prior.T @ of_prior, gradient + of_prior.T @ prior

    def moved(self, delta: Array) -> WeightedPoint:
        """Return the point moved by delta (k,)."""
        return WeightedPoint(point=self.point.step(delta), likelihood=self.likelihood, sign=self.sign)
