"""Rotations and poses: E and its four decompositions, points before both cameras, covariances of poses.

A pose is ``cam2_from_cam1``: a point X of camera 1 is R X + t in camera 2. Coordinates are those of a camera
with K = identity (rays). Only the direction of the translation can be known, and reversing time, which swaps
the ends of every smear, inverts the pose: a pose and its inverse are one answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, AnyArray, Array
from blur2view.geometry.epipolar import cross_matrix, homogeneous

PLANE: Array = np.eye(2, 3)
GENERATORS: Array = cross_matrix(np.eye(3))  # (3, 3, 3): [e_k]x
QUARTER_TURN: Array = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def plane_basis(normal: Array) -> Array:
    """Return two orthonormal vectors (2, 3) perpendicular to a vector (3,), by a Householder reflection."""
    mirror = np.asarray(normal, float) / max(math.sqrt(normal @ normal), TINY)
    mirror[2] += math.copysign(1.0, mirror[2])
    basis: Array = PLANE - mirror[:2, None] * (mirror * (2 / (mirror @ mirror)))
    return basis


def half_sphere(count: int) -> Array:
    """Return unit vectors (count, 3) spread evenly over the half sphere z > 0 (a Fibonacci spiral)."""
    index = np.arange(count)
    z = (index + 0.5) / count
    golden_angle = np.pi * (3 - np.sqrt(5))
    radius, angle = np.sqrt(1 - z * z), golden_angle * index
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def rotation_matrix(vector: Array) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector (3,), radians (Rodrigues' formula)."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, float))[0], float)


def rotation_vector(R: Array) -> Array:
    """Return the rotation vector (3,), radians, of a rotation matrix (3, 3)."""
    return np.asarray(cv2.Rodrigues(R)[0], float).ravel()


def rotation_flow(middle: AnyArray) -> AnyArray:
    """Return the velocities (2, 3, N) of points (N, 2), K = identity, under unit rotations about x, y and z.

    For w they are (w x p)_12 - p (w x p)_3, p homogeneous.
    """
    x, y = middle.T
    return np.array([[-x * y, 1 + x * x, -y], [-(1 + y * y), x * y, x]])


@dataclass(frozen=True, kw_only=True, eq=False)
class RigidTransform:
    """``cam2_from_cam1``: X2 = R X1 + t, R (3, 3), t (3,) of unit length or zero, else ValueError."""

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        R, t = np.array(self.rotation, np.float64), np.array(self.translation, np.float64)
        if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) <= 0:
            raise ValueError(f"rotation must be a rotation matrix (3, 3), got {R.tolist()}")
        if t.shape != (3,) or (t.any() and not abs(np.linalg.norm(t) - 1) < 1e-6):
            raise ValueError(f"translation (3,) must be of unit length or zero, got {t.tolist()}")
        object.__setattr__(self, "rotation", R)
        object.__setattr__(self, "translation", t)

    def inverse(self) -> RigidTransform:
        """Return ``cam1_from_cam2``: the same motion with time reversed."""
        return RigidTransform(rotation=self.rotation.T, translation=-self.rotation.T @ self.translation)

    @property
    def rotation_vector(self) -> Array:
        """Axis times angle, (3,), radians."""
        return rotation_vector(self.rotation)

    @property
    def essential(self) -> Array:
        """E = [t]x R, (3, 3): ``rays2^T E rays1 = 0``."""
        return cross_matrix(self.translation) @ self.rotation


@dataclass(frozen=True, kw_only=True, eq=False)
class AngularVelocity:
    """How fast a camera turned: the rotation vector of ``cam2_from_cam1`` over the exposure time, rad/s.

    About the camera's axes x (right), y (down) and z (forwards); a gyroscope along these shows its negative.
    """

    mean: Array  # (3,)
    covariance: Array  # (3, 3), squared radians per squared second

    def __repr__(self) -> str:
        mean, sigma = (", ".join(f"{v:z.3g}" for v in vector) for vector in (self.mean, self.sigma))
        return f"<AngularVelocity ({mean}) +/- ({sigma}) rad/s>"

    @property
    def sigma(self) -> Array:
        """Standard deviations (3,), radians per second."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0))

    @property
    def of_gyroscope(self) -> AngularVelocity:
        """Angular velocity that a gyroscope along the camera's axes shows: the negative, same covariance."""
        return replace(self, mean=-self.mean)


def decompose_essential(E: Array) -> list[RigidTransform]:
    """Return the four poses of E (3, 3), smaller rotations first (Hartley and Zisserman, result 9.19)."""
    rotations, t = essential_motions(E)
    return [RigidTransform(rotation=R, translation=sign * t) for R in rotations for sign in (1.0, -1.0)]


def essential_motions(E: Array) -> tuple[list[Array], Array]:
    """Return both rotations (3, 3) of the essential matrix nearest to E, the smaller first, and +-t (3,)."""
    U, _, Vt = np.linalg.svd(E)
    U, Vt = U * np.sign(np.linalg.det(U)), Vt * np.sign(np.linalg.det(Vt))
    rotations = sorted((U @ W @ Vt for W in (QUARTER_TURN, QUARTER_TURN.T)), key=lambda R: -np.trace(R))
    return rotations, U[:, 2]


def before_both(pose: RigidTransform, rays1: Array, rays2: Array) -> NDArray[np.bool_]:
    """Return where (N,) rays (N, 2), x/z and y/z, of two cameras meet before both of them (cheirality).

    Both depths of depth2 y = depth1 R x + t, x and y homogeneous, are positive; each is solved across the
    other ray, as noisy rays do not meet. False for parallel rays (Hartley and Zisserman, 2nd ed., section
    9.6.3).
    """
    x, y = homogeneous(rays1) @ pose.rotation.T, homogeneous(rays2)
    normal = np.cross(y, x)
    scale = np.maximum((normal**2).sum(axis=1), TINY)
    depths = [(np.cross(pose.translation, ray) * normal).sum(axis=1) / scale for ray in (x, y)]
    return np.asarray((depths[0] > 0) & (depths[1] > 0))


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseCovariance:
    """Covariance of the error (w, u) of a pose, squared radians.

    The true rotation is exp([w]x) R, the true translation runs along t + u @ tangents, to first order.
    """

    matrix: Array  # (5, 5)
    tangents: Array  # (2, 3): unit vectors perpendicular to t and to each other

    @property
    def rotation_sigma_deg(self) -> Array:
        """Standard deviations (3,) of the rotation about x, y and z of camera 2, degrees."""
        return np.degrees(np.sqrt(np.maximum(np.diag(self.matrix)[:3], 0)))

    @property
    def translation_sigma_deg(self) -> float:
        """Standard deviation of the translation's direction along the worse of its two axes, degrees."""
        return float(np.degrees(np.sqrt(max(np.linalg.eigvalsh(self.matrix[3:, 3:])[-1], 0.0))))

    def inverse(self, pose: RigidTransform) -> PoseCovariance:
        """Return the covariance of the inverse of a pose.

        The inverse of exp([w]x) R is exp([w']x) R^T with w' = -R^T w; t' = -R^T t moves by -R^T (dt - w x t).
        In its tangents -B R, B those of the pose, that is u' = u + B [t]x w.
        """
        step = np.eye(5)
        step[:3, :3] = -pose.rotation.T
        step[3:, :3] = self.tangents @ cross_matrix(pose.translation)
        return PoseCovariance(matrix=step @ self.matrix @ step.T, tangents=-self.tangents @ pose.rotation)
