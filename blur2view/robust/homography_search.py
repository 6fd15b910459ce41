"""Starts for homographies: from four unordered smears, from two for a rotation, in the robust loop."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.rotation import GENERATORS
from blur2view.robust.calibration import CUTOFF
from blur2view.robust.field_fit import FieldFit, fit_field
from blur2view.robust.homography import Field, entries_of, velocity_basis
from blur2view.robust.likelihood import Likelihood
from blur2view.robust.ransac import RansacOptions, ransac, weighted_samples

FOUR_SIGNS: Array = np.array(list(itertools.product([1.0], *[[1.0, -1.0]] * 3)))  # (8, 4)
TWO_SIGNS: Array = FOUR_SIGNS[::4, :2]  # (2, 2): + +, + -
ROTATIONS: Array = entries_of(GENERATORS).T  # (8, 3): entries of A = [w]x are ROTATIONS @ w
SEARCH = RansacOptions(max_iterations=96, confidence=0.99, batch=48)


def solve_signed(basis: Array, displacement: Array, signs: Array) -> Array:
    """Return least-squares solutions (B P, k) of basis @ a = +-displacement: B samples of m, P patterns.

    ``basis`` (k, 2, B, m) is `velocity_basis` at the midpoints, for entries of A or a part of them, the
    displacements are (2, B, m) and the signs (P, m): a smear's order reversed is another pattern; -A, the
    order of time, is left out. Degenerate samples (three midpoints on a line) give meaningless entries.
    """
    parameters, _, samples, size = basis.shape
    rows = basis.transpose(2, 1, 3, 0).reshape(samples, 2 * size, parameters)
    signed = displacement[:, :, None] * signs  # (2, B, P, m)
    right = signed.transpose(1, 2, 0, 3).reshape(samples, len(signs), 2 * size)
    gram = np.swapaxes(rows, 1, 2) @ rows
    gram += (1e-13 * np.trace(gram, axis1=1, axis2=2)[:, None, None] + TINY) * np.eye(rows.shape[2])
    solved = np.linalg.solve(gram, np.swapaxes(right @ rows, 1, 2))
    return np.swapaxes(solved, 1, 2).reshape(-1, parameters)


@dataclass(frozen=True, kw_only=True, eq=False)
class HomographyEstimator:
    """One homography from four unordered smears, or from two if a rotation (`ransac.Estimator`).

    Models are the entries (8,) of A. The score is MSAC's with the first-order displacement v: the squared
    residual |d -+ v|^2 of the better sign is |d|^2 + |v|^2 - 2 |d . v|.
    """

    likelihood: Likelihood
    sample_size: ClassVar[int] = 4  # enough for every homography

    @property
    def count(self) -> int:
        """Number of smears."""
        return len(self.likelihood)

    @cached_property
    def basis(self) -> Array:
        """First-order displacements (8, 2, N) for unit entries."""
        return velocity_basis(self.likelihood.middle)

    @cached_property
    def scaled(self) -> tuple[NDArray[np.float32], ...]:
        """Basis (2, 8, N), displacement (2, N) and squared length (N,) in standard deviations, float32."""
        scale = self.likelihood.unit_px / (np.sqrt(2.0) * self.likelihood.sigma_px)
        basis = np.ascontiguousarray((self.basis * scale).swapaxes(0, 1), np.float32)
        d = np.asarray(self.likelihood.displacement.T * scale, np.float32)
        return basis, d, (d * d).sum(axis=0)

    def generate_models(self, samples: int, rng: np.random.Generator) -> Array:
        """Return candidates (M, 8): eight a sample of four and, given a camera, two a sample of two."""
        displacement, equal = self.likelihood.displacement.T, np.ones(self.count)
        four = weighted_samples(equal, 4, samples, rng)
        models = solve_signed(self.basis[:, :, four], displacement[:, four], FOUR_SIGNS)
        if self.likelihood.has_camera:
            two = weighted_samples(equal, 2, samples, rng)
            basis = np.tensordot(ROTATIONS.T, self.basis[:, :, two], 1)
            models = np.concatenate(
                [models, solve_signed(basis, displacement[:, two], TWO_SIGNS) @ ROTATIONS.T]
            )
        return models[np.isfinite(models).all(axis=1)]

    def residuals(self, models: Array, block: NDArray[np.int_]) -> NDArray[Any]:
        """Return squared residuals (M, n) of the better order in standard deviations."""
        (bx, by), (dx, dy), squared = self.scaled
        entries = np.asarray(models, np.float32)
        vx, vy = entries @ bx[:, block], entries @ by[:, block]  # (M, n)
        along = vx * dx[block] + vy * dy[block]
        value: NDArray[Any] = vx * vx + vy * vy + squared[block] - 2 * np.abs(along)
        return value

    def score(self, models: Array, block: NDArray[np.int_]) -> NDArray[Any]:
        """Return MSAC cost (M,)."""
        total: NDArray[Any] = np.minimum(self.residuals(models, block), CUTOFF**2).sum(axis=1)
        return total

    def refine(self, model: Array) -> Array:
        """Return the entries of the cheapest field near a model, of some of the smears."""
        return fit_field(Field.plane(model, self.likelihood.prior), self.likelihood.thinned).family.parameters

    def inlier_share(self, model: Array) -> float:
        """Return the share of inliers."""
        return float((self.residuals(model[None], np.arange(self.count)) < CUTOFF**2).mean())


def find_plane(likelihood: Likelihood, rng: np.random.Generator) -> FieldFit | None:
    """Return the homography that explains most smears, refined; None if no sample gave any.

    Raises
    ------
    ValueError
        If there are fewer than four smears.
    """
    entries = ransac(HomographyEstimator(likelihood=likelihood), SEARCH, rng).model
    return None if entries is None else fit_field(Field.plane(entries, likelihood.prior), likelihood)
