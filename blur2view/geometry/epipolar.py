"""Formulas of two views: F, its symmetric and skew parts, Sampson distances, ambiguous residuals.

Conventions, as in the whole package: points are (x, y) in pixels; ``points2^T F points1 = 0``; the ends of a
smear are ``ends[:, 0]`` and ``ends[:, 1]`` and their order means nothing.

With midpoint p and half displacement s (ends p - s and p + s) and F = S + [a]x, S symmetric,

    points2^T F points1 = q + l,   q = p^T S p - s^T S s,   l = 2 a . (p x s).

Swapping the two ends of a smear flips l alone, transposing F flips a alone.
"""

from __future__ import annotations

import numpy as np

from blur2view.arrays import TINY, Array

# The nine entries of [v]x, row by row, are v @ CROSS.
CROSS: Array = np.zeros((3, 9))
CROSS[[0, 0, 1, 1, 2, 2], [7, 5, 2, 6, 3, 1]] = [1, -1, 1, -1, 1, -1]


def cross_matrix(vectors: Array) -> Array:
    """Return the matrices [v]x (..., 3, 3) of vectors (..., 3): ``[v]x w = v x w``."""
    vectors = np.asarray(vectors, float)
    return (vectors @ CROSS).reshape(*vectors.shape, 3)


def homogeneous(points: Array) -> Array:
    """Return pixels (..., 2) with a one appended, (..., 3)."""
    points = np.asarray(points, float)
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def transfer(H: Array, points1: Array, points2: Array) -> Array:
    """Return the squared transfer error (N,) of points2 from H points1, halved as both ends share it."""
    mapped = homogeneous(points1) @ H.T
    depth = mapped[:, 2:]
    mapped = mapped[:, :2] / np.where(np.abs(depth) > 1e-12, depth, 1e-12)
    squared: Array = 0.5 * ((mapped - points2) ** 2).sum(axis=1)
    return squared


def unit_norm(F: Array) -> Array:
    """Return matrices (..., 3, 3) scaled to Frobenius norm 1; a zero matrix stays zero."""
    norm = np.linalg.norm(F, axis=(-2, -1), keepdims=True)
    scaled: Array = F / np.maximum(norm, TINY)
    return scaled


def symmetric_skew(F: Array) -> tuple[Array, Array]:
    """Return the parts S (..., 3, 3) and a (..., 3) of F = S + [a]x, shape (..., 3, 3).

    S is zero for a pure translation; the transpose of F has -a.
    """
    transposed = np.swapaxes(F, -2, -1)
    skew = 0.5 * (F - transposed)
    a = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
    return 0.5 * (F + transposed), a


def quadratic_features(ends: Array) -> tuple[Array, Array]:
    """Return coefficients of smears' ends (..., 2, 2) so that points2^T F points1 = q + l.

    Of (S11, S12, S13, S22, S23, S33) in q, (..., 6), and of a in l, (..., 3): swapped ends negate these.
    """
    u, v = np.moveaxis(0.5 * (ends[..., 0, :] + ends[..., 1, :]), -1, 0)
    su, sv = np.moveaxis(0.5 * (ends[..., 1, :] - ends[..., 0, :]), -1, 0)
    one = np.ones_like(u)
    q = [u * u - su * su, 2 * (u * v - su * sv), 2 * u, v * v - sv * sv, 2 * v, one]
    skew = [-2 * sv, 2 * su, 2 * (u * sv - v * su)]
    return np.stack(q, axis=-1), np.stack(skew, axis=-1)


def epipoles(F: Array) -> tuple[Array, Array]:
    """Return the unit homogeneous epipoles e1 (F e1 = 0) and e2 (F^T e2 = 0) of F (..., 3, 3)."""
    U, _, Vt = np.linalg.svd(F)
    return Vt[..., 2, :], U[..., :, 2]


def unit_lines(translations: Array, middle: Array) -> tuple[Array, Array]:
    """Return unit vectors (G, 2, N) along epipolar lines at points (N, 2) and across them, K = identity.

    Along is the way a point before the camera moves: to the epipole if t_z > 0, away from it if t_z < 0.
    """
    lines = translations[:, :2, None] - translations[:, 2, None, None] * middle.T
    along = lines / np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), TINY)
    return along, np.stack([-along[:, 1], along[:, 0]], axis=1)


def fundamental_from_pose(K: Array, R: Array, t: Array) -> Array:
    """Return F of unit norm from K, of both views, and cam2_from_cam1 = (R, t); ValueError if t is zero."""
    if not np.linalg.norm(t) > 0:
        raise ValueError("t is zero: a pure rotation has no fundamental matrix")
    inverse = np.linalg.inv(K)
    return unit_norm(inverse.T @ cross_matrix(np.asarray(t, float)) @ R @ inverse)


def denormalise(F: Array, T: Array) -> Array:
    """Return F (..., 3, 3) of points x from that of points T x: T^T F T, unit norm."""
    return unit_norm(np.swapaxes(T, -2, -1) @ F @ T)
