"""Models of motion as manifolds: F of a camera, and displacement fields of homographies.

Each has parameters, a step along them, derivatives and a normal prior of mean zero. Coordinates are those of
`NormalisedSmears`: x/z and y/z of the camera, assumed or given. ``prior_sigma`` (6,) holds the prior's
standard deviations: of the rotation about x, y and z, radians, of the logarithm of the focal length over that
of this camera, and of the principal point's offset over that focal length; zero fixes a parameter.

A homography between the ends of a short exposure is near the identity. It is written as Cayley's transform
H = (I - A/2)^-1 (I + A/2) of a generator A (3, 3): the transform is exact, -A gives the inverse of H, which
exchanges the two ends of a smear, and A = K [w]x K^-1 gives the homographies K R K^-1 of rotations. With
A_33 = 0 and a_3^T the third row of A, the displacement at the midpoint p is to first order v = (A p)_12 -
p (A p)_3. That of the whole exposure is v + (A p)_3 / 4 L v, L = A_22 - p a_3^T its linear part (A_22 the
upper left 2 x 2 block), with an error of fifth order.
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
class FundamentalManifold:
    """F = K^-T [t]x R K^-1, the same K = [[g, 0, cx], [0, g, cy], [0, 0, 1]] near I at both ends.

    Eight parameters: two of t, three of R, log g, cx and cy; F has seven degrees of freedom. The prior
    `UNROTATED` leaves the two of t, so that all smears point to the epipole.
    """

    t: Array  # (3,) of unit length
    R: Array  # (3, 3)
    intrinsics: Array = field(default_factory=lambda: np.zeros(3))  # log g, cx, cy
    prior_sigma: Array  # (6,): the prior

    @classmethod
    def from_matrix(cls, F: Array, prior_sigma: Array) -> FundamentalManifold:
        """Return the essential matrix nearest to F (K = I), with the smaller of its two rotations."""
        rotations, t = essential_motions(F)
        return cls(t=t, R=rotations[0], prior_sigma=prior_sigma)

    @cached_property
    def rotation_vector(self) -> Array:
        """Rotation vector (3,), radians."""
        return rotation_vector(self.R)

    @cached_property
    def inverse(self) -> Array:
        """K^-1 (3, 3)."""
        return np.asarray(np.linalg.inv(intrinsic_matrix(self.intrinsics)), float)

    def matrix(self) -> Array:
        """Return F of shape (3, 3), not of unit norm."""
        return self.inverse.T @ cross_matrix(self.t) @ self.R @ self.inverse

    def tangent(self) -> Array:
        """Return the derivatives of F in the eight parameters, (8, 3, 3)."""
        rotation_derivatives = cross_matrix(self.t) @ GENERATORS @ self.R
        dE = np.concatenate([cross_matrix(plane_basis(self.t)) @ self.R, rotation_derivatives])
        F, change = self.matrix(), intrinsic_changes(self.intrinsics)
        by_intrinsics = -(np.swapaxes(change, 1, 2) @ F + F @ change)
        return np.concatenate([self.inverse.T @ dE @ self.inverse, by_intrinsics])

    def step(self, delta: Array) -> FundamentalManifold:
        """Return the point reached by delta (8,): t moves on the sphere, R turns from the left, K changes."""
        t: Array = self.t + delta[:2] @ plane_basis(self.t)
        R = rotation_matrix(delta[2:5]) @ self.R
        return replace(self, t=t / math.sqrt(t @ t), R=R, intrinsics=self.intrinsics + delta[5:])

    def prior_residuals(self) -> tuple[Array, Array]:
        """Return the prior's residuals (6,) of rotation, log g, cx and cy, and their Jacobian (6, 8).

        In standard deviations; the Jacobian is that of a small rotation.
        """
        weight = 1 / np.maximum(self.prior_sigma, MIN_SIGMA)
        residuals = np.concatenate([self.rotation_vector, self.intrinsics]) * weight
        return residuals, np.eye(6, 8, 2) * weight[:, None]

    def motion(self) -> tuple[Array, Array]:
        """Return the entries (8,) of the rotation's generator, and the epipole K t (3,), to first order."""
        K = intrinsic_matrix(self.intrinsics)
        return generator_entries(K @ cross_matrix(self.rotation_vector) @ self.inverse), K @ self.t


def intrinsic_matrix(intrinsics: Array) -> Array:
    """Return K = [[g, 0, cx], [0, g, cy], [0, 0, 1]] of intrinsics (3,): log g, cx, cy."""
    log_focal, cx, cy = intrinsics.tolist()
    g = math.exp(log_focal)
    return np.array([[g, 0, cx], [0, g, cy], [0, 0, 1.0]])


def intrinsic_changes(intrinsics: Array) -> Array:
    """Return X = dK K^-1 of log g, cx and cy, (3, 3, 3).

    F changes by -(X^T F + F X), a generator A by X A - A X.
    """
    change = np.zeros((3, 3, 3))
    change[0, :2] = [[1, 0, -intrinsics[1]], [0, 1, -intrinsics[2]]]
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
    """The displacement field of a plane (8 parameters) or a rotation (6); 3 more for a rolling shutter.

    Parameters of a plane are the entries of A row by row, without A33 = 0. Those of a rotation are its vector
    w (R is Cayley's transform of [w]x, an angle of 2 atan(|w| / 2)) and the intrinsics log g, cx and cy of
    `FundamentalManifold`. A rolling shutter reads one row after the other, so that the motion changes down
    the rows: at height y the points move by the rotation y * ``change`` as well. Where a picture was turned
    by 90 degrees its rows follow one another along x, and x stands for y.
    """

    parameters: Array  # (k,): those of the middle row, then, of a rolling shutter, the change (3,)
    turns: bool  # whether it is the field of a rotation
    prior_sigma: Array  # (6,): the prior
    axis: int = 1  # along which the rows follow one another: 0 is x, 1 is y

    @classmethod
    def plane(cls, entries: Array, prior_sigma: Array) -> HomographyFlow:
        """Return the field of a generator's entries (8,)."""
        return cls(parameters=entries, turns=False, prior_sigma=prior_sigma)

    @classmethod
    def rotation(cls, vector: Array, prior_sigma: Array) -> HomographyFlow:
        """Return the field of a rotation vector (3,), seen by a camera of K = I."""
        return cls(parameters=np.append(vector, np.zeros(3)), turns=True, prior_sigma=prior_sigma)

    @property
    def change(self) -> Array:
        """Rotation vector (3,) per unit of height; (0,) of a global shutter."""
        return self.parameters[6 if self.turns else 8 :]

    @property
    def weight(self) -> Array:
        """One over the prior's standard deviations, (k,); a plane's entries have no prior."""
        weight = 1 / np.maximum(self.prior_sigma, MIN_SIGMA)
        middle_weight = weight if self.turns else np.zeros(8)
        return np.append(middle_weight, weight[: len(self.change)] / ROLLING_SPREAD)

    def rolling(self, axis: int) -> HomographyFlow:
        """Return the same field with a change down the rows, now zero, that a fit may alter."""
        return replace(self, parameters=np.append(self.parameters, np.zeros(3)), axis=axis)

    def step(self, delta: Array) -> HomographyFlow:
        """Return the field with delta (k,) added to the parameters."""
        return replace(self, parameters=self.parameters + delta)

    def generator(self) -> Array:
        """Return the generator A (3, 3) of the middle row."""
        if not self.turns:
            return np.append(self.parameters[:8], 0.0).reshape(3, 3)
        K = intrinsic_matrix(self.parameters[3:6])
        return np.asarray(K @ cross_matrix(self.parameters[:3]) @ np.linalg.inv(K))

    def tangent(self) -> Array:
        """Return the derivatives of the middle row's generator in its parameters, (8 or 6, 3, 3)."""
        if not self.turns:
            return ENTRIES
        K, A = intrinsic_matrix(self.parameters[3:6]), self.generator()
        change = intrinsic_changes(self.parameters[3:6])
        return np.concatenate([K @ GENERATORS @ np.linalg.inv(K), change @ A - A @ change])

    def displacement(self, points: Array) -> Array:
        """Return the displacements (N, 2) of smears whose midpoints are ``points`` (N, 2)."""
        displacement = chords(self.generator(), points)
        if len(self.change):
            displacement = displacement + points[:, [self.axis]] * chords(cross_matrix(self.change), points)
        return displacement

    def derivatives(self, basis: Array, points: Array) -> Array:
        """Return the derivatives (k, 2, N) of displacements at points (N, 2), to first order.

        ``basis`` (8, 2, N) is `velocity_basis` at the points, or the same whitened.
        """
        middle = np.tensordot(generator_entries(self.tangent()), basis, 1)
        change = np.tensordot(generator_entries(GENERATORS), basis, 1)[: len(self.change)]
        return np.concatenate([middle, points[:, self.axis] * change])


def cayley(A: Array) -> Array:
    """Return H = (I - A/2)^-1 (I + A/2) of a generator (3, 3); -A gives the inverse of H."""
    return np.asarray(np.linalg.solve(IDENTITY - 0.5 * A, IDENTITY + 0.5 * A), float)


def velocity_basis(points: Array) -> Array:
    """Return the displacements (8, 2, N) at points (N, 2) that entries of A of one give, to first order."""
    x, y = np.asarray(points, float).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    along_x = [x, y, one, zero, zero, zero, -x * x, -x * y]
    along_y = [zero, zero, zero, x, y, one, -x * y, -y * y]
    return np.array([along_x, along_y]).swapaxes(0, 1)


def generator_entries(A: Array) -> Array:
    """Return the entries (..., 8), row by row, of generators (..., 3, 3) after A33 I is taken off.

    A multiple of the identity moves no point.
    """
    return np.asarray((A - A[..., 2, 2, None, None] * IDENTITY).reshape(*A.shape[:-2], 9)[..., :8])


def chords(A: Array, points: Array) -> Array:
    """Return the displacements (N, 2) under H of a generator (3, 3) of smears with midpoints (N, 2).

    v + (A p)_3 / 4 L v: see the head of this module.
    """
    A, p = A - A[2, 2] * IDENTITY, points.T
    third = A[2, :2] @ p
    velocity = A[:2, :2] @ p + A[:2, 2:] - p * third
    linear = A[:2, :2] @ velocity - p * (A[2, :2] @ velocity)  # L v
    chord: Array = velocity + 0.25 * third * linear
    return chord.T
