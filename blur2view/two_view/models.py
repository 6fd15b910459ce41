"""Families of F as manifolds: a point, its tangents, a step, and a prior.

Three nested families describe a blurred photograph: `CameraF` (5 parameters and 3 of the camera, held by a
prior: one camera, the same at both ends, square pixels, principal point near the centre, a small rotation),
that of a camera whose prior is `UNROTATED` (2 parameters: all smears meet in the epipole) and `GeneralF` (all
7). Each has a matrix, its derivatives, a step along them, the motion of a camera, and a prior. Coordinates
are normalised.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.pose import essential_motions
from blur2view.geometry.rotation import (
    GENERATORS,
    plane_basis,
    rotation_matrix,
    rotation_vector,
    step_on_sphere,
)
from blur2view.two_view.constants import ASSUMED_FOCAL


@dataclass(frozen=True, kw_only=True)
class GeneralF:
    """F = U diag(cos w, sin w, 0) V^T, seven parameters: every matrix of rank 2.

    References
    ----------
    Bartoli and Sturm, Nonlinear estimation of the fundamental matrix with minimal parameters, PAMI 2004.
    """

    U: Array  # (3, 3) orthogonal
    V: Array  # (3, 3) orthogonal
    angle: float  # w

    @classmethod
    def from_matrix(cls, F: Array) -> GeneralF:
        """Return the rank-2 matrix nearest to F."""
        U, singular, Vt = np.linalg.svd(F)
        return cls(U=U, V=Vt.T, angle=float(np.arctan2(singular[1], singular[0])))

    def _diagonal(self) -> Array:
        return np.diag([np.cos(self.angle), np.sin(self.angle), 0.0])

    def matrix(self) -> Array:
        """Return F of shape (3, 3), unit norm."""
        return self.U @ self._diagonal() @ self.V.T

    def tangent(self) -> Array:
        """Return dF of shape (7, 3, 3): rotations of U, rotations of V, the angle."""
        middle = self._diagonal()
        derivative = np.diag([-np.sin(self.angle), np.cos(self.angle), 0.0])
        inner = np.concatenate([GENERATORS @ middle, -middle @ GENERATORS, derivative[None]])
        moved: Array = self.U @ inner @ self.V.T
        return moved

    def step(self, delta: Array) -> GeneralF:
        """Return the point with U and V rotated and the angle changed."""
        U, V = self.U @ rotation_matrix(delta[:3]), self.V @ rotation_matrix(delta[3:6])
        return GeneralF(U=U, V=V, angle=self.angle + float(delta[6]))

    def motion(self) -> tuple[Array, Array]:
        """Return the motion of the nearest essential matrix, of its two rotations the smaller."""
        rotations, t = essential_motions(self.matrix())
        return rotation_vector(rotations[0]), t

    def prior(self) -> tuple[Array, Array]:
        """Return no residuals (0,) and their Jacobian (0, 7)."""
        return np.zeros(0), np.zeros((0, 7))


@dataclass(frozen=True, kw_only=True)
class CameraPrior:
    """Standard deviations that hold `CameraF` near what photographs are like.

    ``rotation`` in radians about x, y, z; ``log_focal`` natural log of the focal length over the assumed
    one; ``principal`` the principal point's offset in units of the assumed focal length. Zero fixes a
    parameter of the camera.
    """

    rotation: tuple[float, float, float]
    log_focal: float = 0.3
    principal: float = 0.03

    def __post_init__(self) -> None:
        if not (min(self.rotation) > 0 and self.log_focal >= 0 and self.principal >= 0):
            raise ValueError(f"standard deviations must be positive, got {self}")

    @cached_property
    def weight(self) -> Array:
        """One over the standard deviations (6,) of rotation, log focal length and principal point."""
        return 1 / np.maximum([*self.rotation, self.log_focal, self.principal, self.principal], 1e-9)

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives (6, 8) of the prior's residuals in the parameters of `CameraF`, to first order."""
        return np.eye(6, 8, 2) * self.weight[:, None]


UNROTATED = CameraPrior(rotation=(1e-9, 1e-9, 1e-9), log_focal=0.0, principal=0.0)


@dataclass(frozen=True, kw_only=True)
class CameraF:
    """F = K^-T [t]x R K^-1 with one K = [[g, 0, cx], [0, g, cy], [0, 0, 1]] for both ends.

    Coordinates are those of an assumed camera (principal point at the image's centre, assumed focal
    length), so K is near the identity. Eight parameters (t two, R three, log g, cx, cy) of which seven show
    in F.
    """

    t: Array  # (3,) unit
    R: Array  # (3, 3)
    log_focal: float = 0.0
    principal: Array = field(default_factory=lambda: np.zeros(2))
    spread: CameraPrior

    @classmethod
    def from_matrix(cls, F: Array, spread: CameraPrior) -> CameraF:
        """Return the pose of least rotation of the essential matrix nearest to F (K = identity)."""
        rotations, t = essential_motions(F)
        return cls(t=t, R=rotations[0], spread=spread)

    @cached_property
    def rotation(self) -> Array:
        """Rotation vector (3,), radians."""
        return rotation_vector(self.R)

    @cached_property
    def cross(self) -> Array:
        """[t]x (3, 3)."""
        return cross_matrix(self.t)

    @cached_property
    def inverse(self) -> Array:
        """K^-1 (3, 3)."""
        g = math.exp(self.log_focal)
        cx, cy = self.principal.tolist()
        return np.array([[1 / g, 0, -cx / g], [0, 1 / g, -cy / g], [0, 0, 1.0]])

    def matrix(self) -> Array:
        """Return F of shape (3, 3), not of unit norm."""
        return self.inverse.T @ self.cross @ self.R @ self.inverse

    def tangent(self) -> Array:
        """Return dF of shape (8, 3, 3)."""
        inverse, cross = self.inverse, self.cross
        E = cross @ self.R
        lens = np.zeros((3, 3, 3))  # d(K^-1) K in log g, cx, cy
        lens[0, [0, 1], [0, 1]] = -1.0
        lens[1, 0, 2] = lens[2, 1, 2] = -inverse[0, 0]
        inner = np.empty((8, 3, 3))
        inner[:2] = cross_matrix(plane_basis(self.t)) @ self.R
        inner[2:5] = cross @ GENERATORS @ self.R
        inner[5:] = np.swapaxes(lens, 1, 2) @ E + E @ lens
        tangent: Array = inverse.T @ inner @ inverse
        return tangent

    def step(self, delta: Array) -> CameraF:
        """Return the point with t moved on the sphere, R rotated from the left, the camera changed."""
        return replace(
            self,
            t=step_on_sphere(self.t, delta[:2]),
            R=rotation_matrix(delta[2:5]) @ self.R,
            log_focal=self.log_focal + float(delta[5]),
            principal=self.principal + delta[6:],
        )

    def prior(self) -> tuple[Array, Array]:
        """Return residuals (6,): rotation vector, log g, cx, cy; the rotation's Jacobian to first order."""
        value = np.array([*self.rotation, self.log_focal, *self.principal])
        return value * self.spread.weight, self.spread.jacobian

    def motion(self) -> tuple[Array, Array]:
        """Return its rotation vector and translation; the offset of K from the identity is left out."""
        return self.rotation, self.t


FundamentalModel = CameraF | GeneralF


def assumed_camera(image_size: tuple[float, ...]) -> Array:
    """Return K^-1 (3, 3) of the assumed camera: centred, focal length ASSUMED_FOCAL times the longer side."""
    width, height = image_size
    focal = ASSUMED_FOCAL * max(width, height)
    return np.array(
        [[1 / focal, 0, -(width - 1) / 2 / focal], [0, 1 / focal, -(height - 1) / 2 / focal], [0, 0, 1]]
    )
