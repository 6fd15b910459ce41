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

from blur2view.arrays import TINY, AnyArray, Array

FloatArray = NDArray[np.floating[Any]]

# The nine entries of [v]x, row by row, are v @ CROSS.
CROSS: Array = np.zeros((3, 9))
CROSS[[0, 0, 1, 1, 2, 2], [7, 5, 2, 6, 3, 1]] = [1, -1, 1, -1, 1, -1]
# From the entries of F, row by row, to S11, S12, S13, S22, S23, S33 and a, of F = S + [a]x.
FORMS: Array = np.zeros((9, 9))
for _k, (_i, _j) in enumerate([(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]):
    FORMS[3 * _i + _j, _k] += 0.5
    FORMS[3 * _j + _i, _k] += 0.5
FORMS[:, 6:] = 0.5 * CROSS.T
GRADIENTS: Array = np.zeros((9, 6))  # from G2 - G1, symmetrised, to two rows of it
for _i, _j in np.ndindex(2, 3):
    GRADIENTS[3 * _i + _j, 3 * _i + _j] += 0.5
    GRADIENTS[3 * _j + _i, 3 * _i + _j] += 0.5
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
    scaled: Array = F / np.maximum(np.linalg.norm(F, axis=(-2, -1), keepdims=True), TINY)
    return scaled


def symmetric_skew(F: Array) -> tuple[Array, Array]:
    """Return S (..., 3, 3) and a (..., 3) of F = S + [a]x, (..., 3, 3); the transpose of F has -a."""
    F = np.asarray(F)
    return 0.5 * (F + np.swapaxes(F, -2, -1)), F.reshape(*F.shape[:-2], 9) @ FORMS[:, 6:]


def quadratic_features(ends: Array) -> tuple[Array, Array]:
    """Return coefficients of S11, S12, S13, S22, S23, S33 in q, (..., 6), and of a in l, (..., 3)."""
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


def unit_lines(translations: AnyArray, middle: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return unit vectors (G, 2, N) along epipolar lines at points (N, 2), as these move, and across them."""
    lines = translations[:, :2, None] - translations[:, 2, None, None] * middle.T
    length = np.sqrt(lines[:, 0] ** 2 + lines[:, 1] ** 2)
    along = lines / np.maximum(length, TINY)[:, None]
    return along, np.stack([-along[:, 1], along[:, 0]], axis=1)


def fundamental_from_pose(K: Array, R: Array, t: Array) -> Array:
    """Return F of unit norm from K, of both views, and cam2_from_cam1 = (R, t); ValueError if t is zero."""
    if not np.linalg.norm(t) > 0:
        raise ValueError("t is zero: a pure rotation has no fundamental matrix")
    return denormalise(cross_matrix(np.asarray(t, float)) @ R, np.asarray(np.linalg.inv(K), float))


def denormalise(F: Array, T: Array) -> Array:
    """Return F (..., 3, 3) of points x from that of points T x: T^T F T, unit norm."""
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
    """Return SErrMin (..., N): the smaller squared Sampson distance of both orders of ends (N, 2, 2)."""
    one, other = ends[:, 0], ends[:, 1]
    return np.minimum(sampson(F, one, other), sampson(F, other, one))


class EndProducts:
    """Products of the coordinates of smears' ends, by which Sampson distances of F are products of matrices.

    With x, y = p -+ s (midpoint and half displacement) and F = S + [a]x the Sampson distances of the two
    orders are (q + l) / sqrt(E + O) and (q - l) / sqrt(E - O): q is linear in S, l in a, and the squared
    gradient |(F x)_12|^2 + |(F^T y)_12|^2 = x^T G1 x + y^T G2 y has an even part E, of entries of G1 + G2,
    and an odd one O, of entries of G2 - G1, in the exchange of the ends (Hartley and Zisserman, 11.9).

    Of ends (N, 2, 2), normalised so that coordinates are of order one; ``sigma`` (N,), a smear's standard
    deviation, is the unit of its distances, which in float32 err by about 1e-4 of a pixel.
    """

    def __init__(self, ends: Array, sigma: Array | float = 1.0, dtype: type = np.float64) -> None:
        q, skew = (part.T / sigma for part in quadratic_features(ends))
        (u, v), (su, sv) = ends.mean(axis=1).T, 0.5 * (ends[:, 1] - ends[:, 0]).T
        # monomials of p p^T + s s^T and of 2 s p^T
        even = [u * u + su * su, 2 * (u * v + su * sv), 2 * u, v * v + sv * sv, 2 * v, np.ones_like(u)]
        odd = 2 * np.array([su * u, su * v, su, sv * u, sv * v, sv])
        # both orders side by side, (9, 2 N) and (12, 2 N)
        self._algebraic: FloatArray = np.ascontiguousarray(np.block([[q, q], [skew, -skew]]), dtype)
        gradient = np.block([[np.array(even), np.array(even)], [odd, -odd]])
        self._gradient: FloatArray = np.ascontiguousarray(gradient, dtype)

    def distances(self, F: Array) -> tuple[Array, Array]:
        """Return signed Sampson distances (2, N) of F in both orders, and their gradients' lengths."""
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

    def costs(self, F: Array, limit: float, block: NDArray[np.int_] | slice = slice(None)) -> FloatArray:
        """Return sums (M,) of SErrMin of models F (M, 3, 3) over a block of smears, each at most a limit."""
        half, dtype = self._algebraic.shape[1] // 2, self._algebraic.dtype
        q, skew = np.split(self._algebraic[:, :half][:, block], [6])
        even, odd = np.split(self._gradient[:, :half][:, block], 2)
        F = F.astype(dtype)
        forms, gradients = F.reshape(-1, 9) @ FORMS.astype(dtype), _gradients(F, F)
        total, step = np.empty(len(F), dtype), max(CHUNK // max(q.shape[1], 1), 1)
        for part in (slice(start, start + step) for start in range(0, len(F), step)):
            same, swapped = forms[part, :6] @ q, forms[part, 6:] @ skew
            of_both, apart = gradients[part, :6] @ even, gradients[part, 6:] @ odd
            least = np.minimum(
                _ratio(same + swapped, of_both + apart), _ratio(same - swapped, of_both - apart)
            )
            total[part] = np.minimum(least, dtype.type(limit), out=least).sum(axis=1)
        return total


def _gradients(F: Array, T: Array) -> Array:
    """Return the coefficients (..., 12) of E and O for F = T (..., 3, 3), else half their change along T."""
    gram1 = F[..., 0, :, None] * T[..., 0, None, :] + F[..., 1, :, None] * T[..., 1, None, :]
    gram2 = F[..., :, 0, None] * T[..., None, :, 0] + F[..., :, 1, None] * T[..., None, :, 1]
    even, odd = (one.reshape(*one.shape[:-2], 9) for one in (gram1 + gram2, gram2 - gram1))
    parts = even @ FORMS[:, :6].astype(F.dtype), odd @ GRADIENTS.astype(F.dtype)
    return np.concatenate(parts, axis=-1)


def _ratio(numerator: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return numerator^2 / gradient."""
    squared: FloatArray = numerator * numerator
    squared /= np.maximum(gradient, np.float32(1e-20))
    return squared
