"""Fitting a displacement field, of a rotation or a plane, to smears: one step of `levenberg_marquardt`.

Residuals are counted along and across each smear, heavy tails by Student's distribution; the errors that vary
slowly over the whole picture are six parameters beside those of the field, with a prior. Without them a field
of lengths that err by 4 % would speak against every rotation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic

import numpy as np

from blur2view.arrays import Array
from blur2view.robust.calibration import FIELD_STEPS, FIELD_TOLERANCE, FREEDOM
from blur2view.robust.homography import H, velocity_basis
from blur2view.robust.levenberg_marquardt import levenberg_marquardt
from blur2view.robust.likelihood import Likelihood
from blur2view.robust.residuals import OrderedResiduals

SLOW = 6  # parameters of the errors that vary slowly
# Their precisions. The first, lengths wrong by a share everywhere, is held at zero: no residual shows it, and
# a field that is shorter by as much leaves smaller residuals of direction. The covariance has it.
PRECISION = np.array([1e6, 1, 1, 1, 1, 1])


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldFit(Generic[H]):
    """A field among smears, each in the order that fits it better."""

    likelihood: Likelihood
    family: H
    slow: Array  # (6,) the errors that vary slowly, in standard deviations
    basis: Array  # (N, 2, 8) `velocity_basis` at the midpoints

    @cached_property
    def predicted(self) -> Array:
        """Displacements (N, 2) of the field along and across the smears, in standard deviations."""
        return self.likelihood.whiten(self.family.displacement(self.likelihood.middle))

    @cached_property
    def measured(self) -> Array:
        """The smears (N, 2) likewise, less the errors that vary slowly."""
        likelihood = self.likelihood
        measured = likelihood.whiten(likelihood.displacement)
        return np.asarray(measured - np.tensordot(self.slow, likelihood.slow_errors, 1))

    @cached_property
    def sign(self) -> Array:
        """1 where the smear runs from ends[:, 0] to ends[:, 1], -1 where backward, (N,)."""
        along = (self.predicted * self.likelihood.whiten(self.likelihood.displacement)).sum(axis=1)
        return np.where(along < 0, -1.0, 1.0)

    @cached_property
    def residual(self) -> Array:
        """Residuals (N, 2) along and across, in standard deviations."""
        return np.asarray(self.predicted - self.sign[:, None] * self.measured)

    @property
    def prior_cost(self) -> float:
        """Twice the negative log-prior of the family and of the errors that vary slowly."""
        prior, _ = self.family.prior()
        return float(prior @ prior + PRECISION @ self.slow**2)

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
        moved = likelihood.whiten(self.family.derivatives(self.basis, likelihood.middle))
        k = len(moved)
        jacobian = np.concatenate([moved, self.sign[:, None] * likelihood.slow_errors]).reshape(k + SLOW, -1)
        weight = likelihood.effective_share * (FREEDOM + 2) / (FREEDOM + (self.residual**2).sum(axis=1))
        weighted = jacobian * np.repeat(weight, 2)
        prior, of_family = self.family.prior()
        normal, gradient = weighted @ jacobian.T, weighted @ self.residual.ravel()
        normal[:k, :k] += of_family.T @ of_family
        normal[k:, k:] += np.diag(PRECISION)
        gradient[:k] += of_family.T @ prior
        gradient[k:] += PRECISION * self.slow
        return normal, gradient

    def moved(self, delta: Array) -> FieldFit[H]:
        """Return the fit moved by delta (k,)."""
        return replace(self, family=self.family.step(delta[:-SLOW]), slow=self.slow + delta[-SLOW:])

    def reweighted(self) -> FieldFit[H]:
        """Return itself: its weights are always its own."""
        return self

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


def fit_field(family: H, likelihood: Likelihood) -> FieldFit[H]:
    """Return the cheapest field of a family near a start."""
    basis = velocity_basis(likelihood.middle)
    start = FieldFit(likelihood=likelihood, family=family, slow=np.zeros(SLOW), basis=basis)
    *_, best = start, *levenberg_marquardt(start, FIELD_STEPS, FIELD_TOLERANCE)
    return best
