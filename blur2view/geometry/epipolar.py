"""Formulas of two views: F, its symmetric and skew parts, epipolar lines, Sampson distances.

Conventions of the whole package: points are (x, y) in pixels; ``points2^T F points1 = 0``; which of the two
ends of a smear is ``ends[:, 0]`` and which ``ends[:, 1]`` is arbitrary. Exchanging the ends of every smear
transposes F.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, AnyArray, Array

FloatArray = NDArray[np.floating[Any]]

# The nine entries of [v]x, row by row, are v @ CROSS.
CROSS: Array = np.zeros((3, 9))
CROSS[[0, 0, 1, 1, 2, 2], [7, 5, 2, 6, 3, 1]] = [1, -1, 1, -1, 1, -1]
UPPER = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]  # entries of a symmetric matrix (3, 3)
SYMMETRIC: Array = np.eye(6)[
    [0, 1, 2, 1, 3, 4, 2, 4, 5]
]  # nine entries @ SYMMETRIC: sums at these six places
CHUNK = 16384  # residuals computed at once: beyond the processor's cache each takes 3 to 4 times as long


def cross_matrix(vectors: Array) -> Array:
    """Return the matrices [v]x (..., 3, 3) of vectors (..., 3): ``[v]x w = v x w``."""
    vectors = np.asarray(vectors, float)
    return (vectors @ CROSS).reshape(*vectors.shape, 3)


def homogeneous(points: Array) -> Array:
    """Return pixels (..., 2) with a one appended, (..., 3)."""
    points = np.asarray(points, float)
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def transfer(H: Array, points1: Array, points2: Array) -> Array:
    """Return half the squared distance (N,) of points2 from H points1, as the error lies in both points."""
    mapped = homogeneous(points1) @ H.T
    depth = mapped[:, 2:]
    mapped = mapped[:, :2] / np.where(np.abs(depth) > 1e-12, depth, 1e-12)
    squared: Array = 0.5 * ((mapped - points2) ** 2).sum(axis=1)
    return squared


def unit_norm(F: Array) -> Array:
    """Return matrices (..., 3, 3) scaled to Frobenius norm 1; a zero matrix stays zero."""
    scaled: Array = F / np.maximum(np.linalg.norm(F, axis=(-2, -1), keepdims=True), TINY)
    return scaled


def symmetric_skew(F: Array) -> tuple[Array, Array]:
    """Return S (..., 3, 3) and a (..., 3) of F = S + [a]x, (..., 3, 3); the transpose of F has -a."""
    F = np.asarray(F)
    return 0.5 * (F + np.swapaxes(F, -2, -1)), 0.5 * F.reshape(*F.shape[:-2], 9) @ CROSS.T


def epipoles(F: Array) -> tuple[Array, Array]:
    """Return the unit homogeneous epipoles e1 (F e1 = 0) and e2 (F^T e2 = 0) of F (..., 3, 3)."""
    U, _, Vt = np.linalg.svd(F)
    return Vt[..., 2, :], U[..., :, 2]


def unit_lines(translations: AnyArray, middle: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return unit vectors (G, 2, N) along and across the epipolar lines at points (N, 2).

    ``translations`` (G, 3): points before the camera move along t_12 - t_3 p.
    """
    lines = translations[:, :2, None] - translations[:, 2, None, None] * middle.T
    length = np.sqrt(lines[:, 0] ** 2 + lines[:, 1] ** 2)
    along = lines / np.maximum(length, TINY)[:, None]
    return along, np.stack([-along[:, 1], along[:, 0]], axis=1)


def fundamental_from_pose(K: Array, R: Array, t: Array) -> Array:
    """Return F of unit norm of two views with the same K and cam2_from_cam1 = (R, t).

    ValueError if t is zero.
    """
    if not np.linalg.norm(t) > 0:
        raise ValueError("t is zero: a pure rotation has no fundamental matrix")
    return denormalise(cross_matrix(np.asarray(t, float)) @ R, np.asarray(np.linalg.inv(K), float))


def denormalise(F: Array, T: Array) -> Array:
    """Return T^T F T of unit norm (..., 3, 3): F of points x, given F of points T x."""
    return unit_norm(np.swapaxes(T, -2, -1) @ F @ T)


def sampson(F: Array, points1: Array, points2: Array) -> Array:
    """Return squared Sampson distances (..., N) of matches (N, 2) to F (Hartley and Zisserman, 11.9)."""
    x, y = homogeneous(points1).T, homogeneous(points2).T
    line2 = F @ x  # (..., 3, N)
    line1 = np.swapaxes(F, -2, -1) @ y
    algebraic = (line2 * y).sum(-2)
    gradient = (line2[..., :2, :] ** 2).sum(-2) + (line1[..., :2, :] ** 2).sum(-2)
    squared: Array = algebraic**2 / np.maximum(gradient, TINY)
    return squared


def serrmin(F: Array, ends: Array) -> Array:
    """Return SErrMin (..., N): the squared Sampson distance of ends (N, 2, 2) in the better order."""
    first, second = ends[:, 0], ends[:, 1]
    return np.minimum(sampson(F, first, second), sampson(F, second, first))


class EndProducts:
    """Products of the coordinates of smears' ends, so that Sampson distances of many F are matrix products.

    The Sampson distance of x and y is y^T F x / |((F x)_12, (F^T y)_12)| (Hartley and Zisserman, 11.9). The
    numerator is linear in the entries of F. The squared denominator, the squared length of the gradient, is
    x^T G1 x + y^T G2 y, linear in the entries of G1 = A^T A and G2 = B B^T, A the first two rows of F, B its
    first two columns.

    ``ends`` (N, 2, 2) are normalised so that coordinates are of order one. Distances are in units of
    ``sigma`` (N,), the standard deviation of each smear; in float32 they err by about 1e-4 of a pixel.
    """

    def __init__(self, ends: Array, sigma: Array | float = 1.0, dtype: type = np.float64) -> None:
        first, second = (homogeneous(ends[:, i]).T for i in (0, 1))
        orders = (first, second), (second, first)
        algebraic = [(y[:, None] * x).reshape(9, -1) / sigma for x, y in orders]
        gradient = [[z[UPPER[0]] * z[UPPER[1]] for z in order] for order in orders]
        self._algebraic: FloatArray = np.array(algebraic, dtype)  # (2, 9, N): of both orders
        self._gradient: FloatArray = np.array(gradient, dtype).reshape(2, 12, -1)

    def distances(self, F: Array) -> tuple[Array, Array]:
        """Return signed Sampson distances (2, N) of F in both orders, and the lengths (2, N) of gradients."""
        root = np.sqrt(np.maximum(_gradients(F, F) @ self._gradient, TINY))
        return F.reshape(9) @ self._algebraic / root, root

    def derivatives(self, F: Array, tangents: Array, distance: Array, root: Array | float) -> Array:
        """Return the derivatives (k, 2, N) of `distances` of F along tangents (k, 3, 3)."""
        change = tangents.reshape(-1, 9) @ self._algebraic  # (2, k, N)
        change -= _gradients(F, tangents) @ self._gradient * (distance / root)[:, None]
        return np.asarray(np.swapaxes(change, 0, 1) / root)

    def costs(self, F: Array, limit: float, block: NDArray[np.int_] | slice = slice(None)) -> FloatArray:
        """Return the sums (M,) over a block of smears of SErrMin, cut at ``limit``, of F (M, 3, 3)."""
        algebraic, gradient = self._algebraic[:, :, block], self._gradient[:, :, block]
        F = F.astype(algebraic.dtype)
        entries, gradients = F.reshape(-1, 9), _gradients(F, F)
        total, step = np.empty(len(F), F.dtype), max(CHUNK // max(algebraic.shape[2], 1), 1)
        for part in (slice(start, start + step) for start in range(0, len(F), step)):
            least, other = (entries[part] @ products for products in algebraic)
            for squared, products in zip((least, other), gradient, strict=True):
                squared *= squared
                squared /= np.maximum(gradients[part] @ products, np.float32(1e-20))
            np.minimum(least, other, out=least)
            total[part] = np.minimum(least, F.dtype.type(limit), out=least).sum(axis=1)
        return total


def _gradients(F: Array, dF: Array) -> Array:
    """Return half the change along dF of the coefficients (..., 12) of the squared gradient.

    As these are quadratic in F, they are what is returned for dF = F.
    """
    rows = F[..., 0, :, None] * dF[..., 0, None, :] + F[..., 1, :, None] * dF[..., 1, None, :]
    columns = F[..., :, 0, None] * dF[..., None, :, 0] + F[..., :, 1, None] * dF[..., None, :, 1]
    parts = [gram.reshape(*gram.shape[:-2], 9) @ SYMMETRIC.astype(F.dtype) for gram in (rows, columns)]
    return np.concatenate(parts, axis=-1)
