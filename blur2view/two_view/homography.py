"""Fitting a displacement field, of a rotation or a plane, to smears by `levenberg_marquardt`.

A field says where both ends of a smear are, so the whole end-point error counts. Residuals are counted along
and across each smear, heavy tails by Student's distribution; the errors that vary slowly over the whole
picture are six parameters beside those of the field, with a prior. Without them a field of lengths that err
by 4 % would speak against every rotation.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import symmetric_skew, unit_lines
from blur2view.two_view import constants as c
from blur2view.two_view.constants import FREEDOM
from blur2view.two_view.least_squares import least_of, reweighted_motion
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import HomographyFlow, velocity_basis

SLOW = 6  # parameters of the errors that vary slowly
# Their precisions. The first, lengths wrong by a share everywhere, is held at zero: no residual shows it, and
# a field that is shorter by as much leaves smaller residuals of direction. The covariance has it.
PRECISION = np.array([1e6, 1, 1, 1, 1, 1])


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldLikelihood:
    """Smears, and what a field of them is made of, in standard deviations along and across each smear."""

    smears: Likelihood

    @cached_property
    def whitening(self) -> Array:
        """Matrices (2, 2, N) to components along and across the smear in standard deviations."""
        smears = self.smears
        x, y = smears.displacement.T / np.maximum(np.hypot(*smears.displacement.T), TINY)
        return np.array([[x, y], [-y, x]]) * smears.unit_px / smears.field_sigmas_px[:, None]

    def whiten(self, vectors: Array) -> Array:
        """Return vectors (..., 2, N) along and across the smears in standard deviations."""
        return np.asarray(np.einsum("ijn,...jn->...in", self.whitening, vectors))

    @cached_property
    def displacement(self) -> Array:
        """The smears (2, N) as they are, in standard deviations."""
        return self.whiten(self.smears.displacement.T)

    @cached_property
    def velocities(self) -> Array:
        """The `velocity_basis` (8, 2, N), in standard deviations."""
        return self.whiten(velocity_basis(self.smears.middle))

    @cached_property
    def chance(self) -> Array:
        """Density (N,) of a smear of any direction and no longer, over that of an inlier at best."""
        squared = self.smears.matches.length_px**2 + TINY
        return np.asarray(np.minimum(2 * self.smears.field_sigmas_px.prod(axis=0) / squared, 1))

    @cached_property
    def slow_errors(self) -> Array:
        """Errors (6, 2, N) that vary slowly over the picture, of one deviation, in standard deviations.

        Lengths and directions err by a share of the length, everywhere or in proportion to x or y. The length
        is smoothed: by a share of the measured one an error would also shrink the scatter of the lengths.
        """
        middle, displacement = self.smears.middle, self.smears.displacement
        shared = self.smears.matches.shared
        half = 0.5 * float(np.ptp(middle, axis=0).max()) + TINY
        offset = (middle - np.median(middle, axis=0)) / half
        modes = np.column_stack([np.ones(len(middle)), offset]).T
        length = np.maximum(own := np.hypot(*displacement.T), 0.1 * np.median(own) + TINY)
        basis = np.column_stack([modes.T, offset**2, offset.prod(axis=1)]) / length[:, None]
        smooth = basis @ np.linalg.lstsq(basis, np.ones(len(middle)), rcond=None)[0]
        x, y = np.clip(smooth, 0, None) * displacement.T  # smooth lengths over the measured ones
        errors = (shared.length + c.NO_ERROR) * np.array([x, y])
        across = (shared.direction_rad + c.NO_ERROR) * np.array([-y, x])
        return self.whiten(np.concatenate([modes[:, None] * error for error in (errors, across)]))


@dataclass(frozen=True, kw_only=True, eq=False)
class HomographyFit:
    """A field among smears, each in the order that fits it better: a `least_squares.Problem`."""

    likelihood: FieldLikelihood
    family: HomographyFlow
    slow: Array = field(default_factory=lambda: np.zeros(SLOW))  # errors that vary slowly, in deviations

    @cached_property
    def predicted(self) -> Array:
        """Displacements (2, N) of the field along and across the smears, in standard deviations."""
        return self.likelihood.whiten(self.family.displacement(self.likelihood.smears.middle).T)

    @cached_property
    def measured(self) -> Array:
        """The smears (2, N), less the errors that vary slowly, in standard deviations."""
        slow = np.tensordot(self.slow, self.likelihood.slow_errors, 1)
        return np.asarray(self.likelihood.displacement - slow)

    @cached_property
    def sign(self) -> Array:
        """1 where the smear runs from ends[:, 0] to ends[:, 1], -1 where backward, (N,)."""
        along = (self.predicted * self.likelihood.displacement).sum(axis=0)
        return np.where(along < 0, -1.0, 1.0)

    @cached_property
    def residual(self) -> Array:
        """Residuals (2, N) along and across, in standard deviations."""
        return self.predicted - self.sign * self.measured

    @property
    def prior_cost(self) -> float:
        """Twice the negative log-prior of the field and of the errors that vary slowly."""
        return float(((self.family.weight * self.family.parameters) ** 2).sum() + PRECISION @ self.slow**2)

    @cached_property
    def cost(self) -> float:
        """Twice the negative log-posterior of the better orders, 0 for smears without residuals."""
        data = (FREEDOM + 2) * np.log1p((self.residual**2).sum(axis=0) / FREEDOM).sum()
        return float(self.likelihood.smears.effective_share * data) + self.prior_cost

    @property
    def both(self) -> Array:
        """Residuals (2, 2, N) of the smears as they are and reversed, in standard deviations."""
        return np.stack([self.predicted - self.measured, self.predicted + self.measured])

    @property
    def costs(self) -> Array:
        """Twice the negative log-likelihoods (N,), both orders together, 0 for a perfect inlier."""
        chance = c.OUTLIER_ODDS * self.likelihood.chance
        return np.asarray(-2 * np.log((student(self.both, np.ones(1))[0] + chance) / (1 + chance)))

    @cached_property
    def log_posterior(self) -> float:
        """Log-posterior, both orders of every smear together."""
        data = self.likelihood.smears.effective_share * float(self.costs.sum())
        return -0.5 * (data + self.prior_cost)

    def gain_of_parallax(self, F: Array) -> float:
        """Return the log-likelihood that parallax along the lines of F (3, 3) gains over the field alone.

        The shares of smears that lie by each of PARALLAX_WIDTHS farther along their lines are the likeliest.
        """
        smears = self.likelihood.smears
        (line,), (across,) = unit_lines(symmetric_skew(F)[1][None], smears.middle)  # at mid exposure
        line, across = self.likelihood.whiten(np.stack([line, across]))
        line /= np.maximum(np.hypot(*line), TINY)
        height = line[0] * across[1] - line[1] * across[0]  # deviations per unit off the line
        along = (self.both * line).sum(axis=1)
        off = [smears.residuals(f).both * 2**0.5 * height * smears.sigma for f in (F, F.T)]
        likely = min(off, key=lambda d: float(np.minimum((d**2 + along**2).min(axis=0), 25.0).sum()))
        turned = np.stack([along, likely], axis=1)
        # errors worse than stated, in all directions, and chance: they are no parallax
        other = student(turned / c.WIDER, np.ones(1))[0] / c.WIDER**2 + self.likelihood.chance
        density = student(turned, np.hypot(1.0, [0.0, *c.PARALLAX_WIDTHS]))
        density += smears.matches.shared.outlier_odds * other
        return smears.effective_share * float((mixture(density.T) - np.log(density[0])).sum())

    def normal_equations(self) -> tuple[Array, Array]:
        """Return J^T W J (k, k) and J^T W r (k,) of the field, then the errors that vary slowly."""
        likelihood = self.likelihood
        moved = self.family.derivatives(likelihood.velocities, likelihood.smears.middle)
        jacobian = np.concatenate([moved, self.sign * likelihood.slow_errors])
        jacobian = jacobian.reshape(len(jacobian), -1)
        squared = (self.residual**2).sum(axis=0)
        weight = np.sqrt(likelihood.smears.effective_share * (FREEDOM + 2) / (FREEDOM + squared))
        jacobian *= np.tile(weight, 2)
        precision = np.append(self.family.weight**2, PRECISION)
        prior = precision * np.append(self.family.parameters, self.slow)
        residual = (weight * self.residual).reshape(-1)
        return jacobian @ jacobian.T + np.diag(precision), jacobian @ residual + prior

    def moved(self, delta: Array) -> HomographyFit:
        """Return the fit moved by delta (k,)."""
        return replace(self, family=self.family.step(delta[:-SLOW]), slow=self.slow + delta[-SLOW:])

    def covariance(self) -> Array:
        """Return the covariance (k, k) of the field; errors that vary slowly, which show no residual, add."""
        normal, _ = self.normal_equations()
        inverse = np.linalg.pinv(normal[:-SLOW, :-SLOW], hermitian=True)
        shift = inverse @ normal[:-SLOW, -SLOW:]
        return np.asarray(inverse + shift @ shift.T)

    def distances_px(self, smears: Likelihood) -> Array:
        """Return how far the ends of smears are from the field, (N,), each in its better order, pixels."""
        predicted = self.family.displacement(smears.middle)
        both = [np.hypot(*(predicted - sign * smears.displacement).T) for sign in (1.0, -1.0)]
        return np.asarray(0.5**0.5 * smears.unit_px * np.minimum(*both))


def fit_homography(
    likelihood: FieldLikelihood, *starts: HomographyFlow, steps: int = c.FIELD_STEPS
) -> HomographyFit:
    """Return the cheapest field near a start, or near that of several which is cheaper after some steps."""
    fits = [HomographyFit(likelihood=likelihood, family=field) for field in starts]
    return least_of(fits, c.FIELD_STARTERS, steps, c.FIELD_TOLERANCE)


def find_plane(likelihood: FieldLikelihood, rotation: Array, *orders: NDArray[np.bool_]) -> HomographyFit:
    """Return the cheapest homography near a rotation's entries (8,) or near what follows smears in an order.

    Of the smears with ends[:, 1] first where an order (N,) is true the homography that follows most is
    linear. From there the fit decides every order anew.
    """
    smears = likelihood.smears
    basis, scale = velocity_basis(smears.middle), 2**0.5 * smears.sigma
    signed = [np.where(backward, -1.0, 1.0) * smears.displacement.T for backward in orders]
    linear = [reweighted_motion(basis, d, steps=c.PLANE_STEPS, scale=lambda _: scale)[0] for d in signed]
    starts = (HomographyFlow.plane(start, smears.prior_sigma) for start in (*linear, rotation))
    return fit_homography(likelihood, *starts, steps=2 * c.FIELD_STEPS)


def student(both: Array, widths: Array) -> Array:
    """Return densities (W, N), both orders together, of residuals (2, 2, N) whose first is W ``widths`` wide.

    In units of the density of a perfect inlier of width 1.
    """
    width = widths[:, None, None]
    squared = (both[:, 0] / width) ** 2 + both[:, 1] ** 2  # (W, 2, N)
    density = (1 + squared / FREEDOM) ** (-0.5 * FREEDOM - 1) / width
    return np.asarray(0.5 * density.sum(axis=1))


def mixture(density: Array) -> Array:
    """Return log-densities (N,) of the mixture of greatest likelihood of components of density (N, J)."""
    others = density.shape[1] - 1
    weights = np.array([0.5, *others * [0.5 / others]])
    for _ in range(c.MIXTURE_ROUNDS):
        weights = weights * ((1 / (density @ weights)) @ density) / len(density)
    return np.asarray(np.log(density @ weights))
