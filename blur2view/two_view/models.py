"""Models of motion as manifolds: F of a camera, and displacement fields of homographies.

Each has parameters, a step along them, derivatives and a prior. Coordinates are normalised: those of
`Likelihood`, for a known camera of K = I. A prior, ``sigma`` (6,), holds standard deviations of the rotation
about x, y, z, radians, of the logarithm of the focal length over the assumed one, and of the principal
point's offset in units of that; zero fixes a parameter.

A homography between the ends of a short exposure is near the identity and is written by its generator A as
Cayley's transform H = (I - A/2)^-1 (I + A/2): exact; -A gives the inverse of H and exchanges the two ends of
a smear. A = K [w]x K^-1 gives exactly the rotations K R K^-1. To first order the displacement at p is v(p) =
(A p)_12 - p (A p)_3, quadratic in p and linear in A; the chord of its path is v(p) + (A p)_3 / 4 v(v), to
fifth order in the smear's length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.pose import (
    GENERATORS,
    essential_motions,
    plane_basis,
    rotation_matrix,
    rotation_vector,
)
from blur2view.two_view.constants import ASSUMED_FOCAL, ROLLING_SPREAD

IDENTITY: Array = np.eye(3)
ENTRIES: Array = np.eye(9)[:8].reshape(8, 3, 3)  # A33 = 0 fixes the scale of H
UNROTATED: Array = np.zeros(6)
MIN_SIGMA = 1e-9  # standard deviation of a prior that fixes a parameter


@dataclass(frozen=True, kw_only=True)
class CameraF:
    """F = K^-T [t]x R K^-1 with one K = [[g, 0, cx], [0, g, cy], [0, 0, 1]], near I, for both ends.

    Eight parameters (t two, R three, log g, cx, cy) of which seven show in F; with the prior `UNROTATED` two,
    so that all smears meet in the epipole.
    """

    t: Array  # (3,) unit
    R: Array  # (3, 3)
    lens: Array = field(default_factory=lambda: np.zeros(3))  # log g, cx, cy
    sigma: Array  # (6,): the prior

    @classmethod
    def from_matrix(cls, F: Array, sigma: Array) -> CameraF:
        """Return the pose of least rotation of the essential matrix nearest to F (K = identity)."""
        rotations, t = essential_motions(F)
        return cls(t=t, R=rotations[0], sigma=sigma)

    @cached_property
    def rotation(self) -> Array:
        """Rotation vector (3,), radians."""
        return rotation_vector(self.R)

    @cached_property
    def inverse(self) -> Array:
        """K^-1 (3, 3)."""
        return np.asarray(np.linalg.inv(lens_matrix(self.lens)), float)

    def matrix(self) -> Array:
        """Return F of shape (3, 3), not of unit norm."""
        return self.inverse.T @ cross_matrix(self.t) @ self.R @ self.inverse

    def tangent(self) -> Array:
        """Return dF of shape (8, 3, 3)."""
        turned = cross_matrix(self.t) @ GENERATORS @ self.R
        dE = np.concatenate([cross_matrix(plane_basis(self.t)) @ self.R, turned])
        F, change = self.matrix(), lens_changes(self.lens)
        lens = np.swapaxes(change, 1, 2) @ F + F @ change
        return np.concatenate([self.inverse.T @ dE @ self.inverse, -lens])

    def step(self, delta: Array) -> CameraF:
        """Return the point with t moved on the sphere, R rotated from the left, the camera changed."""
        t: Array = self.t + delta[:2] @ plane_basis(self.t)
        R = rotation_matrix(delta[2:5]) @ self.R
        return replace(self, t=t / math.sqrt(t @ t), R=R, lens=self.lens + delta[5:])

    def prior(self) -> tuple[Array, Array]:
        """Return residuals (6,): rotation vector, log g, cx, cy; their Jacobian (6, 8) to first order."""
        weight = 1 / np.maximum(self.sigma, MIN_SIGMA)
        return np.concatenate([self.rotation, self.lens]) * weight, np.eye(6, 8, 2) * weight[:, None]

    def motion(self) -> tuple[Array, Array]:
        """Return the generator's entries (8,) of its rotation and its epipole K t (3,), to first order."""
        K = lens_matrix(self.lens)
        return entries_of(K @ cross_matrix(self.rotation) @ self.inverse), K @ self.t


def lens_matrix(lens: Array) -> Array:
    """Return K = [[g, 0, cx], [0, g, cy], [0, 0, 1]] of log g, cx, cy."""
    log_focal, cx, cy = lens.tolist()
    g = math.exp(log_focal)
    return np.array([[g, 0, cx], [0, g, cy], [0, 0, 1.0]])


def lens_changes(lens: Array) -> Array:
    """Return dK K^-1 (3, 3, 3) in log g, cx and cy: F changes by -(X^T F + F X), a generator by X A - A X."""
    change = np.zeros((3, 3, 3))
    change[0, :2] = [[1, 0, -lens[1]], [0, 1, -lens[2]]]
    change[[1, 2], [0, 1], 2] = 1.0
    return change


def assumed_camera(image_size: tuple[float, ...]) -> Array:
    """Return K^-1 (3, 3) of the assumed camera: centred, focal length ASSUMED_FOCAL times the longer side."""
    width, height = image_size
    focal = ASSUMED_FOCAL * max(width, height)
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    return np.asarray(np.linalg.inv(K), float)


@dataclass(frozen=True, kw_only=True)
class HomographyFlow:
    """The field of a plane (8 parameters) or a rotation (6), with 3 more where the shutter rolls.

    Those of a plane are the entries of A row by row, without A33 = 0; of a rotation its vector w (R is
    Cayley's transform of [w]x, an angle of 2 atan(|w| / 2)), and log g, cx and cy as in `CameraF`. A rolling
    shutter reads one row after the other: at y (normalised, downwards; x of a picture turned by 90 degrees,
    as ``axis`` says) the points move by the rotation y * change as well.
    """

    parameters: Array  # (k,): those of the middle row, then the change (3,)
    turns: bool
    sigma: Array  # (6,): the prior
    axis: int = 1  # 0: x, along which rows follow one another in a picture that was turned upright

    @classmethod
    def plane(cls, entries: Array, sigma: Array) -> HomographyFlow:
        """Return the field of a generator's entries (8,)."""
        return cls(parameters=entries, turns=False, sigma=sigma)

    @classmethod
    def rotation(cls, vector: Array, sigma: Array) -> HomographyFlow:
        """Return the field of a rotation vector (3,) of the assumed camera (K = I)."""
        return cls(parameters=np.append(vector, np.zeros(3)), turns=True, sigma=sigma)

    @property
    def change(self) -> Array:
        """Rotation vector per unit of height, (3,) or, of a global shutter, (0,)."""
        return self.parameters[6 if self.turns else 8 :]

    @property
    def weight(self) -> Array:
        """One over the prior's standard deviations of the parameters, (k,)."""
        weight = 1 / np.maximum(self.sigma, MIN_SIGMA)
        return np.append(weight if self.turns else np.zeros(8), weight[: len(self.change)] / ROLLING_SPREAD)

    def rolling(self, axis: int) -> HomographyFlow:
        """Return the same field with a change down the rows, along y (1) or x (0), of zero."""
        return replace(self, parameters=np.append(self.parameters, np.zeros(3)), axis=axis)

    def step(self, delta: Array) -> HomographyFlow:
        """Return the field with delta (k,) added to the parameters."""
        return replace(self, parameters=self.parameters + delta)

    def generator(self) -> Array:
        """Return A of shape (3, 3) of the middle row."""
        if not self.turns:
            return np.append(self.parameters[:8], 0.0).reshape(3, 3)
        K = lens_matrix(self.parameters[3:6])
        return np.asarray(K @ cross_matrix(self.parameters[:3]) @ np.linalg.inv(K))

    def tangent(self) -> Array:
        """Return dA of shape (8 or 6, 3, 3) of the middle row."""
        if not self.turns:
            return ENTRIES
        K, A, lens = lens_matrix(self.parameters[3:6]), self.generator(), lens_changes(self.parameters[3:6])
        return np.concatenate([K @ GENERATORS @ np.linalg.inv(K), lens @ A - A @ lens])

    def displacement(self, points: Array) -> Array:
        """Return the displacements (N, 2) of smears whose midpoints are ``points`` (N, 2)."""
        moved = chords(self.generator(), points)
        if len(self.change):
            moved = moved + points[:, [self.axis]] * chords(cross_matrix(self.change), points)
        return moved

    def derivatives(self, basis: Array, points: Array) -> Array:
        """Return their derivatives (k, 2, N), to first order, of `velocity_basis` at points (N, 2)."""
        middle = np.tensordot(entries_of(self.tangent()), basis, 1)
        change = np.tensordot(entries_of(GENERATORS), basis, 1)[: len(self.change)]
        return np.concatenate([middle, points[:, self.axis] * change])


def cayley(A: Array) -> Array:
    """Return H = (I - A/2)^-1 (I + A/2) of a generator (3, 3); -A gives the inverse of H."""
    return np.asarray(np.linalg.solve(IDENTITY - 0.5 * A, IDENTITY + 0.5 * A), float)


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
