"""A rotation or any homography among smears whose errors are known: along, across, all over the picture.

At mid exposure a homography of generator A moves the point p by v(p) = (A p)_12 - p (A p)_3, which is linear
in A; the chord of its path is v(p) + (A p)_3 / 4 v(v), to fifth order in the smear's length. Residuals are
counted along and across each smear by the bulk of its errors, heavy tails by Student's distribution, and the
errors that vary slowly over the whole picture are six parameters beside those of A, with a prior: lengths and
directions wrong by a share, the same everywhere or in proportion to x or y. Without them a field of lengths
that err by 4 % would speak against every rotation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import homogeneous
from blur2view.robust.homography import Homographies, velocity_basis
from blur2view.robust.levenberg_marquardt import levenberg_marquardt
from blur2view.robust.problem import SmearProblem

FREEDOM = 4.0  # degrees of freedom of Student's distribution of the residuals
LOW_FREQUENCY = 6  # parameters of the errors that vary slowly
STEPS, TOLERANCE = 12, 1e-4  # Levenberg-Marquardt steps, and the relative decrease that ends them
NO_ERROR = 1e-9  # standard deviation that holds a low-frequency error at zero

H = TypeVar("H", bound=Homographies)


@dataclass(frozen=True, kw_only=True, eq=False)
class FlowData:
    """Smears as displacements at mid exposure, with their errors; coordinates of K near the identity."""

    middle: Array  # (N, 2)
    displacement: Array  # (N, 2)
    whitening: Array  # (N, 2, 2) to components along and across the smear in standard deviations
    low_frequency: Array  # (6, N, 2) errors over the picture, of one deviation, for the smears as directed
    weight: float  # share of the smears that counts as independent

    @classmethod
    def of(cls, problem: SmearProblem, bulk_px: tuple[Array, Array]) -> FlowData:
        """Return the smears of a problem whose errors along and across have deviations ``bulk_px``, (N,)."""
        middle, d = problem.middle, problem.ends[:, 1] - problem.ends[:, 0]
        unit = d / np.maximum(np.hypot(*d.T), TINY)[:, None]
        normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        along, across = (sigma[:, None] / problem.unit_px for sigma in bulk_px)
        half = 0.5 * float(np.ptp(middle, axis=0).max()) + TINY
        modes = np.column_stack([np.ones(len(middle)), (middle - np.median(middle, axis=0)) / half]).T
        errors = (
            (problem.shared.length + NO_ERROR) * d,
            (problem.shared.direction_rad + NO_ERROR) * d[:, ::-1] * [-1.0, 1.0],
        )
        return cls(
            middle=middle,
            displacement=d,
            whitening=np.stack([unit / along, normal / across], axis=1),
            low_frequency=np.concatenate([modes[:, :, None] * error for error in errors]),
            weight=problem.data_weight,
        )

    def without_low_frequency(self) -> FlowData:
        """Return the smears as if no error varied slowly over the picture."""
        return replace(self, low_frequency=NO_ERROR * self.low_frequency)

    @cached_property
    def velocities(self) -> Array:
        """Displacements (N, 2, 8) for unit entries of A, to first order."""
        return velocity_basis(self.middle)

    @cached_property
    def basis(self) -> Array:
        """Whitened displacements (N, 2, 8) for unit entries of A."""
        return self.whitening @ self.velocities

    @cached_property
    def whitened(self) -> tuple[Array, Array]:
        """The displacements (N, 2) and the low-frequency errors (6, N, 2) in standard deviations."""
        low_frequency = np.einsum("nij,mnj->mni", self.whitening, self.low_frequency)
        return np.einsum("nij,nj->ni", self.whitening, self.displacement), low_frequency


@dataclass(frozen=True, kw_only=True, eq=False)
class FlowFit(Generic[H]):
    """A homography among smears (`levenberg_marquardt.Reweighted`), each in the order that fits it better."""

    data: FlowData
    family: H
    low_frequency: Array  # (6,) the errors that vary slowly, in standard deviations

    @cached_property
    def predicted(self) -> Array:
        """Whitened displacements (N, 2) that the homography predicts."""
        A, middle = self.family.generator(), self.data.middle
        moved = self.data.velocities @ _entries(A)
        third = moved @ A[:2, :2].T - middle * (moved @ A[2, :2])[:, None]
        chord = moved + (homogeneous(middle) @ (0.25 * A[2]))[:, None] * third
        return np.asarray(np.einsum("nij,nj->ni", self.data.whitening, chord))

    @cached_property
    def sign(self) -> Array:
        """1 where the smear runs from ends[:, 0] to ends[:, 1], -1 where backward, (N,)."""
        measured, _ = self.data.whitened
        return np.where((self.predicted * measured).sum(axis=1) < 0, -1.0, 1.0)

    @cached_property
    def residual(self) -> Array:
        """Residuals (N, 2) along and across, in standard deviations."""
        measured, low_frequency = self.data.whitened
        explained = measured - np.einsum("m,mni->ni", self.low_frequency, low_frequency)
        return np.asarray(self.predicted - self.sign[:, None] * explained)

    @cached_property
    def cost(self) -> float:
        """Twice the negative log-posterior, 0 for smears without residuals."""
        prior, _ = self.family.prior()
        data = (FREEDOM + 2) * np.log1p((self.residual**2).sum(axis=1) / FREEDOM).sum()
        return float(self.data.weight * data + prior @ prior + self.low_frequency @ self.low_frequency)

    def normal_equations(self) -> tuple[Array, Array]:
        """Return J^T W J (k, k) and J^T W r (k,) of the homography, then the low-frequency errors."""
        _, low_frequency = self.data.whitened
        moved = np.moveaxis(self.data.basis @ _entries(self.family.tangent()).T, -1, 0)
        k = len(moved)
        jacobian = np.concatenate([moved, self.sign[:, None] * low_frequency]).reshape(k + LOW_FREQUENCY, -1)
        weight = self.data.weight * (FREEDOM + 2) / (FREEDOM + (self.residual**2).sum(axis=1))
        weighted = jacobian * np.repeat(weight, 2)
        prior, of_family = self.family.prior()
        normal, gradient = weighted @ jacobian.T, weighted @ self.residual.ravel()
        normal[:k, :k] += of_family.T @ of_family
        normal[k:, k:] += np.eye(LOW_FREQUENCY)
        gradient[:k] += of_family.T @ prior
        gradient[k:] += self.low_frequency
        return normal, gradient

    def moved(self, delta: Array) -> FlowFit[H]:
        """Return the fit moved by delta (k,)."""
        family, low_frequency = self.family.step(delta[:-LOW_FREQUENCY]), delta[-LOW_FREQUENCY:]
        return replace(self, family=family, low_frequency=self.low_frequency + low_frequency)

    def reweighted(self) -> FlowFit[H]:
        """Return itself: its weights are always its own."""
        return self

    def covariance(self, share: float, data: FlowData) -> Array:
        """Return the covariance (k, k) of a homography that was fitted as if nothing erred slowly.

        ``share`` of the smears is independent; ``data`` are the same smears with the errors that vary slowly:
        each moves the optimum, and leaves no residual that would tell.
        """
        there = replace(self, data=replace(data, weight=share), low_frequency=np.zeros(LOW_FREQUENCY))
        normal, _ = there.normal_equations()
        inverse = np.linalg.pinv(normal[:-LOW_FREQUENCY, :-LOW_FREQUENCY], hermitian=True)
        shift = inverse @ normal[:-LOW_FREQUENCY, -LOW_FREQUENCY:]
        return np.asarray(inverse + shift @ shift.T)


def fit_flow(family: H, data: FlowData) -> FlowFit[H]:
    """Return the cheapest homography of a family near a start."""
    start = FlowFit(data=data, family=family, low_frequency=np.zeros(LOW_FREQUENCY))
    *_, best = start, *levenberg_marquardt(start, STEPS, TOLERANCE)
    return best


def _entries(A: Array) -> Array:
    """Return the entries (..., 8) of generators (..., 3, 3) with A33 = 0, which move points alike."""
    return np.asarray((A - A[..., 2, 2, None, None] * np.eye(3)).reshape(*A.shape[:-2], 9)[..., :8])
