"""Formulas of two views: F, its symmetric and skew parts, Sampson distances in both orders of a smear.

Conventions, as in the whole package: points are (x, y) in pixels; ``points2^T F points1 = 0``; the ends of a
smear are ``ends[:, 0]`` and ``ends[:, 1]`` and their order means nothing.

With midpoint p and half displacement s (ends p - s and p + s) and F = S + [a]x, S symmetric,

    points2^T F points1 = q + l,   q = p^T S p - s^T S s,   l = 2 a . (p x s).

Swapping the two ends of a smear flips l alone, transposing F flips a alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array

FloatArray = NDArray[np.floating[Any]]

# The nine entries of [v]x, row by row, are v @ CROSS.
CROSS: Array = np.zeros((3, 9))
CROSS[[0, 0, 1, 1, 2, 2], [7, 5, 2, 6, 3, 1]] = [1, -1, 1, -1, 1, -1]
UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])
# From the entries of F, row by row, to S11, S12, S13, S22, S23, S33 and a, of F = S + [a]x.
FORMS: Array = np.zeros((9, 9))
for _k, (_i, _j) in enumerate(zip(*UPPER, strict=True)):
    FORMS[3 * _i + _j, _k] += 0.5
    FORMS[3 * _j + _i, _k] += 0.5
FORMS[[7, 5, 2, 6, 3, 1], [6, 6, 7, 7, 8, 8]] = [0.5, -0.5, 0.5, -0.5, 0.5, -0.5]
# From G1 + G2 and G2 - G1, symmetrised, to the upper half of the one and two rows of the other.
GRADIENTS: Array = np.zeros((18, 12))
GRADIENTS[:9, :6] = FORMS[:, :6]
for _i, _j in np.ndindex(2, 3):
    GRADIENTS[9 + 3 * _i + _j, 6 + 3 * _i + _j] += 0.5
    GRADIENTS[9 + 3 * _j + _i, 6 + 3 * _i + _j] += 0.5
CHUNK = 16384  # residuals of models at once: beyond the processor's cache each takes 3 to 4 times as long


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
    length = np.sqrt(lines[:, 0] ** 2 + lines[:, 1] ** 2)
    along = lines / np.maximum(length, TINY)[:, None]
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


def sampson(F: Array, points1: Array, points2: Array) -> Array:
    """Return squared Sampson distances (..., N) of ordered matches (N, 2) to F (..., 3, 3), squared pixels.

    Zero for exact matches, and at a match lying on both epipoles.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd ed., equation 11.9.
    """
    x, y = homogeneous(points1).T, homogeneous(points2).T
    line2 = F @ x  # (..., 3, N)
    line1 = np.swapaxes(F, -2, -1) @ y
    algebraic = (line2 * y).sum(-2)
    gradient = (line2[..., :2, :] ** 2).sum(-2) + (line1[..., :2, :] ** 2).sum(-2)
    squared: Array = algebraic**2 / np.maximum(gradient, TINY)
    return squared


def serrmin(F: Array, ends: Array) -> Array:
    """Return SErrMin: the smaller of the squared Sampson distances of the two orders of each smear.

    Of F (..., 3, 3), or its transpose, and ends (N, 2, 2): (..., N), squared pixels.
    """
    one, other = ends[:, 0], ends[:, 1]
    return np.minimum(sampson(F, one, other), sampson(F, other, one))


class EndProducts:
    """Products of the coordinates of smears' ends, by which Sampson distances of F are products of matrices.

    With x, y = p -+ s (midpoint and half displacement) and F = S + [a]x the Sampson distances of the two
    orders are (q + l) / sqrt(E + O) and (q - l) / sqrt(E - O): q is linear in S, l in a (`epipolar`), and the
    squared gradient |(F x)_12|^2 + |(F^T y)_12|^2 = x^T G1 x + y^T G2 y has an even part E, of entries of
    G1 + G2, and an odd one O, of entries of G2 - G1, in the exchange of the ends.

    Parameters
    ----------
    ends : ndarray of shape (N, 2, 2)
        Normalised, so that coordinates are of order one: in float32 distances err by about 1e-4 of a pixel.
    sigma : ndarray of shape (N,) or float
        Unit of the distances of every smear, as its standard deviation.
    dtype : numpy dtype

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd ed., equation 11.9.
    """

    def __init__(self, ends: Array, sigma: Array | float = 1.0, dtype: type = np.float64) -> None:
        q, skew = (part.T / sigma for part in quadratic_features(ends))
        p, s = ends.mean(axis=1), 0.5 * (ends[:, 1] - ends[:, 0])
        even, odd = (part.T for part in _gradient_features(p, s))
        self.count = len(ends)
        # both orders side by side, (9, 2 N) and (12, 2 N)
        self._algebraic: FloatArray = np.ascontiguousarray(np.block([[q, q], [skew, -skew]]), dtype)
        self._gradient: FloatArray = np.ascontiguousarray(np.block([[even, even], [odd, -odd]]), dtype)

    def distances(self, F: Array) -> tuple[Array, Array]:
        """Return signed Sampson distances (2, N) of F (3, 3), ends[:, 0] first and ends[:, 1] first.

        Beside them the lengths (2, N) of their gradients, which `derivatives` takes.
        """
        root = np.sqrt(np.maximum(_gradients(F, F) @ self._gradient, TINY)).reshape(2, -1)
        return (F.reshape(9) @ FORMS @ self._algebraic).reshape(2, -1) / root, root

    def derivatives(self, F: Array, tangents: Array, distance: Array, root: Array | float) -> Array:
        """Return how the distances of F change (k, 2, N) along tangents (k, 3, 3)."""
        change = (tangents.reshape(-1, 9) @ FORMS @ self._algebraic).reshape(len(tangents), 2, -1)
        gradient = (_gradients(F, tangents) @ self._gradient).reshape(change.shape)
        gradient *= distance / root
        change -= gradient
        change /= root
        return np.asarray(change)

    def costs(self, F: Array, limit: float, block: slice | NDArray[np.int_] = slice(None)) -> FloatArray:
        """Return the sums (M,) of SErrMin of models F (M, 3, 3) over a block of smears, each at most a limit.

        Few models at a time, whose residuals stay in the processor's cache.
        """
        forms, gradients = F.reshape(-1, 9) @ FORMS, _gradients(F, F)
        rows = [
            np.asarray(part, self._gradient.dtype)
            for part in (*np.split(forms, [6], 1), *np.split(gradients, 2, 1))
        ]
        one = self._algebraic[:, : self.count][:, block], self._gradient[:, : self.count][:, block]
        columns = [*np.split(one[0], [6]), *np.split(one[1], 2)]
        total, step = np.empty(len(F), rows[0].dtype), max(CHUNK // max(columns[0].shape[1], 1), 1)
        for start in range(0, len(F), step):
            part = slice(start, start + step)
            q, skew, even, odd = (row[part] @ column for row, column in zip(rows, columns, strict=True))
            least = np.minimum(_ratio(q + skew, even + odd), _ratio(q - skew, even - odd))
            total[part] = np.minimum(least, least.dtype.type(limit), out=least).sum(axis=1)
        return total


def _gradients(F: Array, T: Array) -> Array:
    """Return the coefficients (..., 12) of E and O for F = T (..., 3, 3), else half their change along T."""
    gram1 = np.swapaxes(F[..., :2, :], -2, -1) @ T[..., :2, :]
    gram2 = F[..., :2] @ np.swapaxes(T[..., :2], -2, -1)
    grams = np.stack([gram1 + gram2, gram2 - gram1], axis=-3)
    return np.asarray(grams.reshape(*grams.shape[:-3], 18) @ GRADIENTS)


def _gradient_features(p: Array, s: Array) -> tuple[Array, Array]:
    """Return monomials of p p^T + s s^T and of 2 s p^T, (N, 6), with homogeneous p and s = (su, sv, 0)."""
    u, v, su, sv = p[:, 0], p[:, 1], s[:, 0], s[:, 1]
    one = np.ones_like(u)
    even = [u * u + su * su, 2 * (u * v + su * sv), 2 * u, v * v + sv * sv, 2 * v, one]
    odd = [2 * su * u, 2 * su * v, 2 * su, 2 * sv * u, 2 * sv * v, 2 * sv]
    return np.stack(even, axis=1), np.stack(odd, axis=1)


def _ratio(numerator: FloatArray, gradient: FloatArray) -> FloatArray:
    squared: FloatArray = numerator * numerator
    squared /= np.maximum(gradient, np.float32(1e-20))
    return squared
