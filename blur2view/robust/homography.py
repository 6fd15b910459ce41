"""Homographies of smears whose order is unknown: families as manifolds, displacements.

An exposure is short, so a homography between its ends is near the identity and is written by its generator
A as Cayley's transform H = (I - A/2)^-1 (I + A/2): exact, the inverse of H has -A, and exchanging the two
ends of a smear is exchanging A and -A. A = K [w]x K^-1 gives exactly the rotations K R K^-1. To first order
the displacement at p is v(p) = +-((A p)_12 - p (A p)_3), quadratic in p and linear in A; the chord of its
path is v(p) + (A p)_3 / 4 v(v), to fifth order in the smear's length. Coordinates are those of `Likelihood`:
for a known camera, of K = I.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Generic, Protocol, TypeVar

import numpy as np

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix, unit_norm
from blur2view.geometry.rotation import GENERATORS
from blur2view.robust.calibration import ROLLING_SPREAD
from blur2view.robust.parametrization import CameraPrior, Family

IDENTITY: Array = np.eye(3)
ENTRIES: Array = np.eye(9)[:8].reshape(8, 3, 3)  # A33 = 0 fixes the scale of H


class Homographies(Family, Protocol):
    """A family of homographies near the identity, by the generator A."""

    def generator(self) -> Array:
        """Return A of shape (3, 3); of a rolling shutter that of the middle row."""

    def displacement(self, points: Array) -> Array:
        """Return the displacements (N, 2) of smears whose midpoints are ``points`` (N, 2)."""
        return chords(self.generator(), points)

    def derivatives(self, basis: Array, points: Array) -> Array:
        """Return their derivatives (k, N, 2), to first order; ``basis`` is `velocity_basis` at the points."""
        return np.moveaxis(basis @ entries_of(self.tangent()).T, -1, 0)


H = TypeVar("H", bound=Homographies)


@dataclass(frozen=True, kw_only=True)
class PlaneH(Homographies):
    """Every homography near the identity: one plane, eight parameters."""

    dimension: ClassVar[int] = 8
    entries: Array  # (8,): A row by row, without A33 = 0

    def generator(self) -> Array:
        """Return A of shape (3, 3)."""
        return np.append(self.entries, 0.0).reshape(3, 3)

    def tangent(self) -> Array:
        """Return dA of shape (8, 3, 3)."""
        return ENTRIES

    def step(self, delta: Array) -> PlaneH:
        """Return the point with delta added to the entries."""
        return PlaneH(entries=self.entries + delta)


@dataclass(frozen=True, kw_only=True)
class RotationH(Homographies):
    """H = K R K^-1 with K = [[g, 0, cx], [0, g, cy], [0, 0, 1]]: pure rotation, three parameters.

    The three of the camera, log g, cx and cy, are held by ``spread`` as in `CameraF`; standard
    deviations of zero fix them. R is Cayley's transform of [rotation]x, an angle of 2 atan(|rotation| / 2).
    """

    dimension: ClassVar[int] = 6
    rotation: Array  # (3,) radians to first order
    log_focal: float = 0.0
    principal: Array
    spread: CameraPrior

    @classmethod
    def from_generator(cls, A: Array, spread: CameraPrior) -> RotationH:
        """Return the rotation nearest to A for the assumed camera (K = I)."""
        rotation = 0.5 * np.array([A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1]])
        return cls(rotation=rotation, principal=np.zeros(2), spread=spread)

    def camera(self) -> Array:
        """Return K of shape (3, 3)."""
        g, (cx, cy) = np.exp(self.log_focal), self.principal
        return np.array([[g, 0, cx], [0, g, cy], [0, 0, 1.0]])

    def generator(self) -> Array:
        """Return A of shape (3, 3)."""
        K = self.camera()
        conjugate: Array = K @ cross_matrix(self.rotation) @ np.linalg.inv(K)
        return conjugate

    def tangent(self) -> Array:
        """Return dA of shape (6, 3, 3): rotation, log g, cx, cy."""
        K = self.camera()
        inverse, A, change = np.linalg.inv(K), self.generator(), np.zeros((3, 3, 3))
        change[0, [0, 1], [0, 1]] = K[0, 0]
        change[[1, 2], [0, 1], 2] = 1.0
        lens = change @ inverse  # dK K^-1, and dA = dK K^-1 A - A dK K^-1
        return np.concatenate([K @ GENERATORS @ inverse, lens @ A - A @ lens])

    def step(self, delta: Array) -> RotationH:
        """Return the point with delta added to the parameters."""
        return replace(
            self,
            rotation=self.rotation + delta[:3],
            log_focal=self.log_focal + float(delta[3]),
            principal=self.principal + delta[4:],
        )

    def prior(self) -> tuple[Array, Array]:
        """Return residuals (6,), rotation, log g, cx and cy, and their Jacobian."""
        value = np.concatenate([self.rotation, [self.log_focal], self.principal])
        return value * self.spread.weight, np.diag(self.spread.weight)


@dataclass(frozen=True, kw_only=True)
class RollingH(Homographies, Generic[H]):
    """A homography with a rotation that changes down the rows, read one after the other.

    At y (normalised, downwards; x of a picture turned by 90 degrees, as ``axis`` says) the points move by the
    rotation y change, besides; the prior holds ``change`` to what a hand does while a shutter rolls
    (`calibration.ROLLING_SPREAD`).
    """

    dimension: ClassVar[int] = 11  # at most: three more than those of the middle row
    middle: H  # of the middle row
    change: Array  # (3,) radians per unit of y
    spread: CameraPrior
    axis: int = 1  # 0: x, along which rows follow one another in a picture that was turned upright

    def generator(self) -> Array:
        """Return A of shape (3, 3) of the middle row."""
        return self.middle.generator()

    def tangent(self) -> Array:
        """Return dA of shape (k, 3, 3), the last three per unit of y."""
        return np.concatenate([self.middle.tangent(), GENERATORS])

    def displacement(self, points: Array) -> Array:
        """Return the displacements (N, 2) of smears whose midpoints are ``points`` (N, 2)."""
        changing = points[:, [self.axis]] * chords(cross_matrix(self.change), points)
        return self.middle.displacement(points) + changing

    def derivatives(self, basis: Array, points: Array) -> Array:
        """Return their derivatives (k, N, 2), to first order."""
        changing = np.moveaxis(basis @ entries_of(GENERATORS).T, -1, 0)
        return np.concatenate([self.middle.derivatives(basis, points), points[:, [self.axis]] * changing])

    def step(self, delta: Array) -> RollingH[H]:
        """Return the point with delta added to the parameters."""
        return replace(self, middle=self.middle.step(delta[:-3]), change=self.change + delta[-3:])

    def prior(self) -> tuple[Array, Array]:
        """Return residuals, those of the middle row and the change, and their Jacobian."""
        value, jacobian = self.middle.prior()
        weight, (rows, columns) = self.spread.weight[:3] / ROLLING_SPREAD, jacobian.shape
        both = np.zeros((rows + 3, columns + 3))
        both[:rows, :columns], both[rows:, columns:] = jacobian, np.diag(weight)
        return np.append(value, self.change * weight), both


def cayley(A: Array) -> Array:
    """Return H = (I - A/2)^-1 (I + A/2) of a generator (3, 3); -A gives the inverse of H."""
    return np.asarray(np.linalg.solve(IDENTITY - 0.5 * A, IDENTITY + 0.5 * A), float)


def pixel_homography(A: Array, T: Array) -> Array:
    """Return H (3, 3) of pixels, unit norm and positive determinant, from A in coordinates T x."""
    return unit_norm(np.asarray(np.linalg.solve(T, cayley(A) @ T), float))


def velocity_basis(points: Array) -> Array:
    """Return displacements (N, 2, 8) at points (N, 2) for unit entries of A, to first order."""
    x, y = np.asarray(points, float).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    along_x = [x, y, one, zero, zero, zero, -x * x, -x * y]
    along_y = [zero, zero, zero, x, y, one, -x * y, -y * y]
    return np.stack([np.stack(along_x, axis=1), np.stack(along_y, axis=1)], axis=1)


def entries_of(A: Array) -> Array:
    """Return the entries (..., 8) of generators (..., 3, 3) with A33 = 0, which move points alike."""
    return np.asarray((A - A[..., 2, 2, None, None] * IDENTITY).reshape(*A.shape[:-2], 9)[..., :8])


def chords(A: Array, points: Array) -> Array:
    """Return the chords (N, 2) of the paths of a generator (3, 3) whose midpoints are points (N, 2)."""
    A = A - A[2, 2] * IDENTITY
    third = points @ A[2, :2]
    moved = points @ A[:2, :2].T + A[:2, 2] - points * third[:, None]
    bent = moved @ A[:2, :2].T - points * (moved @ A[2, :2])[:, None]
    chord: Array = moved + 0.25 * third[:, None] * bent
    return chord
