"""Fitting a displacement field, of a rotation or a plane, to smears by `levenberg_marquardt`.

Residuals are counted along and across each smear, heavy tails by Student's distribution; the errors that vary
slowly over the whole picture are six parameters beside those of the field, with a prior. Without them a field
of lengths that err by 4 % would speak against every rotation.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from blur2view.arrays import Array
from blur2view.robust.calibration import FIELD_STEPS, FIELD_TOLERANCE, FREEDOM
from blur2view.robust.homography import Field
from blur2view.robust.levenberg_marquardt import levenberg_marquardt
from blur2view.robust.likelihood import Likelihood
from blur2view.robust.residuals import OrderedResiduals

SLOW = 6  # parameters of the errors that vary slowly
# Their precisions. The first, lengths wrong by a share everywhere, is held at zero: no residual shows it, and
# a field that is shorter by as much leaves smaller residuals of direction. The covariance has it.
PRECISION = np.array([1e6, 1, 1, 1, 1, 1])


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldFit:
    """A field among smears, each in the order that fits it better."""

    likelihood: Likelihood
    family: Field
    slow: Array = field(default_factory=lambda: np.zeros(SLOW))  # errors that vary slowly, in deviations

    @cached_property
    def predicted(self) -> Array:
        """Displacements (N, 2) of the field along and across the smears, in standard deviations."""
        return self.likelihood.whiten(self.family.displacement(self.likelihood.middle))

    @cached_property
    def sign(self) -> Array:
        """1 where the smear runs from ends[:, 0] to ends[:, 1], -1 where backward, (N,)."""
        along = (self.predicted * self.likelihood.whiten(self.likelihood.displacement)).sum(axis=1)
        return np.where(along < 0, -1.0, 1.0)

    @cached_property
    def residual(self) -> Array:
        """Residuals (N, 2) along and across, in standard deviations."""
        return self.predicted - self.sign[:, None] * self.likelihood.measured(self.slow)

    @property
    def prior_cost(self) -> float:
        """Twice the negative log-prior of the field and of the errors that vary slowly."""
        return float(((self.family.weight * self.family.parameters) ** 2).sum() + PRECISION @ self.slow**2)

    @cached_property
    def cost(self) -> float:
        """Twice the negative log-posterior of the better orders, 0 for smears without residuals."""
        data = (FREEDOM + 2) * np.log1p((self.residual**2).sum(axis=1) / FREEDOM).sum()
        return float(self.likelihood.effective_share * data) + self.prior_cost

    @cached_property
    def log_posterior(self) -> float:
        """Log-posterior, both orders of every smear together."""
        costs = self.likelihood.field_costs(self.predicted, self.slow)
        return -0.5 * (self.likelihood.effective_share * float(costs.sum()) + self.prior_cost)

    def normal_equations(self) -> tuple[Array, Array]:
        """Return J^T W J (k, k) and J^T W r (k,) of the field, then the errors that vary slowly."""
        likelihood = self.likelihood
        moved = likelihood.whiten(self.family.derivatives(likelihood.middle))
        jacobian = np.concatenate([moved, self.sign[:, None] * likelihood.slow_errors])
        jacobian = jacobian.reshape(len(jacobian), -1)
        weight = likelihood.effective_share * (FREEDOM + 2) / (FREEDOM + (self.residual**2).sum(axis=1))
        weighted = jacobian * np.repeat(weight, 2)
        precision = np.append(self.family.weight**2, PRECISION)
        prior = precision * np.append(self.family.parameters, self.slow)
        return weighted @ jacobian.T + np.diag(precision), weighted @ self.residual.ravel() + prior

    def moved(self, delta: Array) -> FieldFit:
        """Return the fit moved by delta (k,)."""
        return replace(self, family=self.family.step(delta[:-SLOW]), slow=self.slow + delta[-SLOW:])

    def covariance(self) -> Array:
        """Return the covariance (k, k) of the field; errors that vary slowly, which show no residual, add."""
        normal, _ = self.normal_equations()
        inverse = np.linalg.pinv(normal[:-SLOW, :-SLOW], hermitian=True)
        shift = inverse @ normal[:-SLOW, -SLOW:]
        return np.asarray(inverse + shift @ shift.T)

    def orders(self, likelihood: Likelihood) -> OrderedResiduals:
        """Return how far smears are from the field, in deviations of a Sampson distance, in both orders."""
        predicted = self.family.displacement(likelihood.middle)
        sigma = 2**0.5 * likelihood.sigma_px / likelihood.unit_px
        both = [np.hypot(*(predicted - sign * likelihood.displacement).T) / sigma for sign in (1.0, -1.0)]
        return OrderedResiduals(both=np.stack(both))


def fit_field(start: Field, likelihood: Likelihood) -> FieldFit:
    """Return the cheapest field near a start."""
    first = FieldFit(likelihood=likelihood, family=start)
    *_, best = levenberg_marquardt(first, FIELD_STEPS, FIELD_TOLERANCE)
    return best
