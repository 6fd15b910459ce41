"""Displacement fields of homographies whose order is unknown: of a rotation or a plane, or row after row.

An exposure is short, so a homography between its ends is near the identity and is written by its generator
A as Cayley's transform H = (I - A/2)^-1 (I + A/2): exact, the inverse of H has -A, and exchanging the two
ends of a smear is exchanging A and -A. A = K [w]x K^-1 gives exactly the rotations K R K^-1. To first order
the displacement at p is v(p) = +-((A p)_12 - p (A p)_3), quadratic in p and linear in A; the chord of its
path is v(p) + (A p)_3 / 4 v(v), to fifth order in the smear's length. Coordinates are those of `Likelihood`:
for a known camera, of K = I.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix, unit_norm
from blur2view.geometry.rotation import GENERATORS
from blur2view.two_view.constants import ROLLING_SPREAD
from blur2view.two_view.models import CameraPrior

IDENTITY: Array = np.eye(3)
ENTRIES: Array = np.eye(9)[:8].reshape(8, 3, 3)  # A33 = 0 fixes the scale of H


@dataclass(frozen=True, kw_only=True)
class HomographyFlow:
    """The field of a plane (8 parameters) or a rotation (6), with 3 more where the shutter rolls.

    Those of a plane are the entries of A row by row, without A33 = 0; of a rotation with K = [[g, 0, cx],
    [0, g, cy], [0, 0, 1]] its vector (R is Cayley's transform of [w]x, an angle of 2 atan(|w| / 2)), log g,
    cx and cy, held by ``spread`` as in `CameraF`. A rolling shutter reads one row after the other: at y
    (normalised, downwards; x of a picture turned by 90 degrees, as ``axis`` says) the points move by the
    rotation y * change, besides; its prior is what a hand does meanwhile (`constants.ROLLING_SPREAD`).
    """

    parameters: Array  # (k,): those of the middle row, then the change (3,)
    turns: bool
    spread: CameraPrior
    axis: int = 1  # 0: x, along which rows follow one another in a picture that was turned upright

    @classmethod
    def plane(cls, entries: Array, spread: CameraPrior) -> HomographyFlow:
        """Return the field of a generator's entries (8,)."""
        return cls(parameters=entries, turns=False, spread=spread)

    @classmethod
    def rotation(cls, vector: Array, spread: CameraPrior) -> HomographyFlow:
        """Return the field of a rotation vector (3,) of the assumed camera (K = I)."""
        return cls(parameters=np.append(vector, np.zeros(3)), turns=True, spread=spread)

    @property
    def change(self) -> Array:
        """Rotation vector per unit of height, (3,) or, of a global shutter, (0,)."""
        return self.parameters[6 if self.turns else 8 :]

    @property
    def weight(self) -> Array:
        """One over the prior's standard deviations of the parameters, (k,)."""
        still = self.spread.weight if self.turns else np.zeros(8)
        return np.append(still, self.spread.weight[: len(self.change)] / ROLLING_SPREAD)

    def rolling(self, axis: int = 1) -> HomographyFlow:
        """Return the same field with a change down the rows, of zero."""
        return replace(self, parameters=np.append(self.parameters, np.zeros(3)), axis=axis)

    def step(self, delta: Array) -> HomographyFlow:
        """Return the field with delta (k,) added to the parameters."""
        return replace(self, parameters=self.parameters + delta)

    def generator(self) -> Array:
        """Return A of shape (3, 3) of the middle row."""
        if not self.turns:
            return np.append(self.parameters[:8], 0.0).reshape(3, 3)
        K = self._camera()
        return np.asarray(K @ cross_matrix(self.parameters[:3]) @ np.linalg.inv(K))

    def _camera(self) -> Array:
        g, (cx, cy) = np.exp(self.parameters[3]), self.parameters[4:6]
        return np.array([[g, 0, cx], [0, g, cy], [0, 0, 1.0]])

    def tangent(self) -> Array:
        """Return dA of shape (8 or 6, 3, 3) of the middle row."""
        if not self.turns:
            return ENTRIES
        K, A, change = self._camera(), self.generator(), np.zeros((3, 3, 3))
        change[0, [0, 1], [0, 1]] = K[0, 0]
        change[[1, 2], [0, 1], 2] = 1.0
        lens = change @ np.linalg.inv(K)  # dK K^-1, and dA = dK K^-1 A - A dK K^-1
        return np.concatenate([K @ GENERATORS @ np.linalg.inv(K), lens @ A - A @ lens])

    def displacement(self, points: Array) -> Array:
        """Return the displacements (N, 2) of smears whose midpoints are ``points`` (N, 2)."""
        moved = chords(self.generator(), points)
        return (
            moved + points[:, [self.axis]] * chords(cross_matrix(self.change), points)
            if len(self.change)
            else moved
        )

    def derivatives(self, basis: Array, points: Array) -> Array:
        """Return their derivatives (k, 2, N), to first order, of `velocity_basis` at points (N, 2)."""
        middle = np.tensordot(entries_of(self.tangent()), basis, 1)
        if not len(self.change):
            return middle
        change = np.tensordot(entries_of(GENERATORS), basis, 1)
        return np.concatenate([middle, points[:, self.axis] * change])


def rotation_of(A: Array) -> Array:
    """Return the rotation vector (3,) nearest to a generator A (3, 3), for K = I: that of its skew part."""
    return 0.5 * np.array([A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1]])


def cayley(A: Array) -> Array:
    """Return H = (I - A/2)^-1 (I + A/2) of a generator (3, 3); -A gives the inverse of H."""
    return np.asarray(np.linalg.solve(IDENTITY - 0.5 * A, IDENTITY + 0.5 * A), float)


def pixel_homography(A: Array, T: Array) -> Array:
    """Return H (3, 3) of pixels, unit norm and positive determinant, from A in coordinates T x."""
    return unit_norm(np.asarray(np.linalg.solve(T, cayley(A) @ T), float))


def velocity_basis(points: Array) -> Array:
    """Return displacements (8, 2, N) at points (N, 2) for unit entries of A, to first order."""
    x, y = np.asarray(points, float).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    along_x = [x, y, one, zero, zero, zero, -x * x, -x * y]
    along_y = [zero, zero, zero, x, y, one, -x * y, -y * y]
    return np.array([along_x, along_y]).swapaxes(0, 1)


def entries_of(A: Array) -> Array:
    """Return the entries (..., 8) of the generators with A33 = 0 that equal given ones (..., 3, 3).

    Adding a multiple of the identity to a generator moves no point.
    """
    return np.asarray((A - A[..., 2, 2, None, None] * IDENTITY).reshape(*A.shape[:-2], 9)[..., :8])


def chords(A: Array, points: Array) -> Array:
    """Return the chords (N, 2) of the paths of a generator (3, 3) whose midpoints are points (N, 2)."""
    A, p = A - A[2, 2] * IDENTITY, points.T
    third = A[2, :2] @ p
    moved = A[:2, :2] @ p + A[:2, 2:] - p * third
    bent = A[:2, :2] @ moved - p * (A[2, :2] @ moved)
    chord: Array = moved + 0.25 * third * bent
    return chord.T
