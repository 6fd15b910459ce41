"""Fitting a displacement field, of a rotation or a plane, to smears by `levenberg_marquardt`.

A field says where both ends of a smear are, so a residual is the whole end-point error, along and across
the smear. Residuals have Student's distribution, for its heavy tails. Errors that vary slowly over the
picture are six more parameters with a prior: without them lengths that are wrong by 4 % everywhere would
speak against every rotation.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import symmetric_skew, unit_lines
from blur2view.smears.noise import ACROSS_SHARE, SAMPSON_SHARE
from blur2view.two_view import constants as c
from blur2view.two_view.constants import FREEDOM
from blur2view.two_view.least_squares import race, reweighted_motion
from blur2view.two_view.likelihood import NormalisedSmears
from blur2view.two_view.models import HomographyFlow, velocity_basis

SLOW = 6  # parameters of the errors that vary slowly, in standard deviations
# Precisions of their prior. The first, lengths wrong by a share everywhere, is held at zero: no residual
# shows it, and a field that is shorter by as much leaves smaller residuals of direction. The covariance
# includes it.
PRECISION = np.array([1e6, 1, 1, 1, 1, 1])


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldLikelihood:
    """Smears and velocities, whitened: along and across each smear, in standard deviations."""

    smears: NormalisedSmears

    @cached_property
    def whitening(self) -> Array:
        """Matrices (2, 2, N) from normalised vectors to components along and across, standard deviations."""
        smears = self.smears
        x, y = smears.displacement.T / np.maximum(np.hypot(*smears.displacement.T), TINY)
        return np.array([[x, y], [-y, x]]) * smears.unit_px / smears.field_sigmas_px[:, None]

    def whiten(self, vectors: Array) -> Array:
        """Return normalised vectors (..., 2, N) along and across the smears, in standard deviations."""
        return np.asarray(np.einsum("ijn,...jn->...in", self.whitening, vectors))

    @cached_property
    def displacement(self) -> Array:
        """The measured displacements (2, N), whitened."""
        return self.whiten(self.smears.displacement.T)

    @cached_property
    def velocities(self) -> Array:
        """The `velocity_basis` (8, 2, N), whitened."""
        return self.whiten(velocity_basis(self.smears.middle))

    @cached_property
    def chance(self) -> Array:
        """Density (N,) of an outlier, of any direction and no longer, over an inlier's at its greatest."""
        squared_length = self.smears.matches.length_px**2 + TINY
        return np.asarray(np.minimum(2 * self.smears.field_sigmas_px.prod(axis=0) / squared_length, 1))

    @cached_property
    def slow_errors(self) -> Array:
        """Errors (6, 2, N) that vary slowly over the picture, of one standard deviation each, whitened.

        Three of lengths, as a share of them, and three of directions: the same everywhere, and in proportion
        to x and y. They scale smoothed lengths: scaling the measured ones would shrink their scatter and
        lower the cost.
        """
        middle, displacement = self.smears.middle, self.smears.displacement
        shared = self.smears.matches.shared
        half = 0.5 * float(np.ptp(middle, axis=0).max()) + TINY
        offset = (middle - np.median(middle, axis=0)) / half
        modes = np.column_stack([np.ones(len(middle)), offset]).T
        length = np.hypot(*displacement.T)
        length = np.maximum(length, 0.1 * np.median(length) + TINY)
        basis = np.column_stack([modes.T, offset**2, offset.prod(axis=1)]) / length[:, None]
        smooth = basis @ np.linalg.lstsq(basis, np.ones(len(middle)), rcond=None)[0]
        x, y = np.clip(smooth, 0, None) * displacement.T  # smooth lengths over the measured ones
        errors = (shared.length + c.NO_ERROR) * np.array([x, y])
        across = (shared.direction_rad + c.NO_ERROR) * np.array([-y, x])
        return self.whiten(np.concatenate([modes[:, None] * error for error in (errors, across)]))


@dataclass(frozen=True, kw_only=True, eq=False)
class HomographyFit:
    """A field with its cost for smears, each in the order that fits better: a `least_squares.Problem`."""

    likelihood: FieldLikelihood
    family: HomographyFlow
    slow: Array = field(default_factory=lambda: np.zeros(SLOW))  # sizes of the errors that vary slowly

    @cached_property
    def predicted(self) -> Array:
        """Displacements (2, N) of the field, whitened."""
        return self.likelihood.whiten(self.family.displacement(self.likelihood.smears.middle).T)

    @cached_property
    def measured(self) -> Array:
        """Measured displacements (2, N) less the errors that vary slowly, whitened."""
        slow = np.tensordot(self.slow, self.likelihood.slow_errors, 1)
        return np.asarray(self.likelihood.displacement - slow)

    @cached_property
    def sign(self) -> Array:
        """1 where the field runs from ends[:, 0] to ends[:, 1], else -1, (N,)."""
        along = (self.predicted * self.likelihood.displacement).sum(axis=0)
        return np.where(along < 0, -1.0, 1.0)

    @cached_property
    def residual(self) -> Array:
        """Residuals (2, N) of the better order, whitened."""
        return self.predicted - self.sign * self.measured

    @property
    def prior_cost(self) -> float:
        """Twice the negative log-prior of the field and of the errors that vary slowly."""
        return float(((self.family.weight * self.family.parameters) ** 2).sum() + PRECISION @ self.slow**2)

    @cached_property
    def cost(self) -> float:
        """Twice the negative log-posterior, every smear in its better order."""
        data = (FREEDOM + 2) * np.log1p((self.residual**2).sum(axis=0) / FREEDOM).sum()
        return float(self.likelihood.smears.effective_share * data) + self.prior_cost

    @property
    def both(self) -> Array:
        """Residuals (2, 2, N) of both orders, ends[:, 0] first and ends[:, 1] first, whitened."""
        return np.stack([self.predicted - self.measured, self.predicted + self.measured])

    @property
    def costs(self) -> Array:
        """Twice the negative log-likelihood (N,) of each smear, both orders added; 0 without residual."""
        chance = c.OUTLIER_ODDS * self.likelihood.chance
        return np.asarray(-2 * np.log((student(self.both, np.ones(1))[0] + chance) / (1 + chance)))

    @cached_property
    def log_posterior(self) -> float:
        """Log-posterior, both orders of every smear added."""
        data = self.likelihood.smears.effective_share * float(self.costs.sum())
        return -0.5 * (data + self.prior_cost)

    def parallax_gain(self, F: Array) -> float:
        """Return the log-likelihood that parallax along the lines of F (3, 3) gains over the field alone.

        The displacement along the lines is a mixture of distributions of several widths (`PARALLAX_WIDTHS`,
        and none); its shares are fitted by maximum likelihood.
        """
        smears = self.likelihood.smears
        (lines,), (normals,) = unit_lines(symmetric_skew(F)[1][None], smears.middle)  # at mid exposure
        lines, normals = self.likelihood.whiten(np.stack([lines, normals]))
        lines /= np.maximum(np.hypot(*lines), TINY)
        deviations = lines[0] * normals[1] - lines[1] * normals[0]  # that one unit off the line is
        along = (self.both * lines).sum(axis=1)
        off = [smears.residuals(f).both * ACROSS_SHARE * deviations * smears.sigma for f in (F, F.T)]
        # the fields' order in time is that of F or of its transpose; a smear decides by 5 deviations at most
        nearer = min(off, key=lambda d: float(np.minimum((d**2 + along**2).min(axis=0), 25.0).sum()))
        residuals = np.stack([along, nearer], axis=1)
        # errors larger than stated, and outliers, go in all directions, so that they say nothing of parallax
        outliers = student(residuals / c.WIDER, np.ones(1))[0] / c.WIDER**2 + self.likelihood.chance
        density = student(residuals, np.hypot(1.0, [0.0, *c.PARALLAX_WIDTHS]))
        density += smears.matches.shared.outlier_odds * outliers
        return smears.effective_share * float((mixture(density.T) - np.log(density[0])).sum())

    def normal_equations(self) -> tuple[Array, Array]:
        """Return J^T W J (k, k) and J^T W r (k,) of the field's parameters, then of slowly varying errors."""
        likelihood = self.likelihood
        field_derivatives = self.family.derivatives(likelihood.velocities, likelihood.smears.middle)
        jacobian = np.concatenate([field_derivatives, self.sign * likelihood.slow_errors])
        jacobian = jacobian.reshape(len(jacobian), -1)
        squared = (self.residual**2).sum(axis=0)
        weight = np.sqrt(likelihood.smears.effective_share * (FREEDOM + 2) / (FREEDOM + squared))
        jacobian *= np.tile(weight, 2)
        precision = np.append(self.family.weight**2, PRECISION)
        prior_gradient = precision * np.append(self.family.parameters, self.slow)
        residual = (weight * self.residual).reshape(-1)
        return jacobian @ jacobian.T + np.diag(precision), jacobian @ residual + prior_gradient

    def moved(self, delta: Array) -> HomographyFit:
        """Return the fit moved by delta (k,)."""
        return replace(self, family=self.family.step(delta[:-SLOW]), slow=self.slow + delta[-SLOW:])

    def covariance(self) -> Array:
        """Return the covariance (k, k) of the field's parameters, with that of the slowly varying errors."""
        normal, _ = self.normal_equations()
        inverse = np.linalg.pinv(normal[:-SLOW, :-SLOW], hermitian=True)
        shift = inverse @ normal[:-SLOW, -SLOW:]
        return np.asarray(inverse + shift @ shift.T)

    def distances_px(self, smears: NormalisedSmears) -> Array:
        """Return the distances (N,) of smears' ends from the field, each in its better order, pixels."""
        predicted = self.family.displacement(smears.middle)
        both = [np.hypot(*(predicted - sign * smears.displacement).T) for sign in (1.0, -1.0)]
        return np.asarray(SAMPSON_SHARE * smears.unit_px * np.minimum(*both))


def fit_homography(
    likelihood: FieldLikelihood, *starts: HomographyFlow, steps: int = c.FIELD_STEPS
) -> HomographyFit:
    """Return the field of least cost reached from the starts; several race as in `race`."""
    fits = [HomographyFit(likelihood=likelihood, family=field) for field in starts]
    return race(fits, c.FIELD_STARTERS, steps, c.FIELD_TOLERANCE)


def find_plane(likelihood: FieldLikelihood, rotation: Array, *orders: NDArray[np.bool_]) -> HomographyFit:
    """Return the homography of least cost; the fit decides the order of every smear anew.

    Starts: the rotation, as entries (8,) of its generator, and for each given order (N,), true where
    ends[:, 1] comes first, the homography fitted linearly to smears in that order.
    """
    smears = likelihood.smears
    basis, scale = velocity_basis(smears.middle), ACROSS_SHARE * smears.sigma
    ordered = [np.where(backward, -1.0, 1.0) * smears.displacement.T for backward in orders]
    linear = [reweighted_motion(basis, d, steps=c.PLANE_STEPS, scale=lambda _: scale)[0] for d in ordered]
    starts = (HomographyFlow.plane(start, smears.prior_sigma) for start in (*linear, rotation))
    return fit_homography(likelihood, *starts, steps=2 * c.FIELD_STEPS)


def student(both: Array, widths: Array) -> Array:
    """Return Student's densities (W, N) of residuals (2, 2, N), both orders' mean, for ``widths`` (W,).

    A width is the scale of the first component; that of the second is 1. A density of 1 is that of residuals
    of zero at a width of 1.
    """
    width = widths[:, None, None]
    squared = (both[:, 0] / width) ** 2 + both[:, 1] ** 2  # (W, 2, N)
    density = (1 + squared / FREEDOM) ** (-0.5 * FREEDOM - 1) / width
    return np.asarray(0.5 * density.sum(axis=1))


def mixture(density: Array) -> Array:
    """Return the log-densities (N,) of a mixture of components (N, J), its shares of maximum likelihood."""
    others = density.shape[1] - 1
    weights = np.array([0.5] + [0.5 / others] * others)
    for _ in range(c.MIXTURE_ROUNDS):
        weights = weights * ((1 / (density @ weights)) @ density) / len(density)
    return np.asarray(np.log(density @ weights))
