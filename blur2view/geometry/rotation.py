"""Rotations, directions on the sphere, and how points move under a small rotation."""

from __future__ import annotations

import math

import cv2
import numpy as np

from blur2view.arrays import TINY, AnyArray, Array
from blur2view.geometry.epipolar import cross_matrix

PLANE: Array = np.eye(2, 3)
GENERATORS: Array = cross_matrix(np.eye(3))  # (3, 3, 3): [e_k]x


def plane_basis(normal: Array) -> Array:
    """Return two orthonormal vectors (2, 3) perpendicular to a vector (3,), by its reflection."""
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
    """Return the rotation vector (3,) in radians of a rotation matrix."""
    return np.asarray(cv2.Rodrigues(R)[0], float).ravel()


def step_on_sphere(unit: Array, delta: Array) -> Array:
    """Return a unit vector (3,) moved by delta (2,) in its tangent plane (`plane_basis`)."""
    moved: Array = unit + delta @ plane_basis(unit)
    return moved / math.sqrt(moved @ moved)


def rotation_flow(middle: AnyArray) -> AnyArray:
    """Return the motion (2, 3, N) of points (N, 2), K = identity, per radian: w x p - p (w x p)_z."""
    x, y = middle.T
    return np.array([[-x * y, 1 + x * x, -y], [-(1 + y * y), x * y, x]])
