"""Sampson distances: of ordered matches, of the better order, of many F on the same smears."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import homogeneous, quadratic_features

FloatArray = NDArray[np.floating[Any]]
UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])
CHUNK = 16384  # residuals of models at once: beyond the processor's cache each takes 3 to 4 times as long


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
        Best of order one: in float32 distances err by about 1e-4 of a normalised pixel.
    sigma : ndarray of shape (N,) or float
        Unit of the distances of every smear, as its standard deviation.
    dtype : numpy dtype

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd ed., equation 11.9.
    """

    def __init__(self, ends: Array, sigma: Array | float = 1.0, dtype: type = np.float64) -> None:
        q, skew = quadratic_features(ends)
        p, s = ends.mean(axis=1), 0.5 * (ends[:, 1] - ends[:, 0])
        even, odd = _gradient_features(p, s)
        parts = q.T / sigma, skew.T / sigma, even.T, odd.T
        self._features: list[FloatArray] = [
            np.ascontiguousarray(part, dtype) for part in parts
        ]  # (6 or 3, N)

    def distances(self, F: Array) -> tuple[Array, Array]:
        """Return signed Sampson distances (2, N) of F (3, 3), ends[:, 0] first and ends[:, 1] first.

        Beside them the lengths (2, N) of their gradients, which `derivatives` takes.
        """
        f = _entries(F)
        root = np.sqrt(np.maximum(self._squared_gradient(f, f)[0], TINY))
        return self._algebraic(f)[0] / root, root

    def derivatives(self, F: Array, tangents: Array, distance: Array, root: Array | float) -> Array:
        """Return how the distances of F change (k, 2, N) along tangents (k, 3, 3)."""
        t = _entries(tangents)
        change = self._algebraic(t)
        gradient = self._squared_gradient(_entries(F), t)
        gradient *= distance / root
        change -= gradient
        change /= root
        return change

    def costs(self, F: Array, limit: float, block: slice | NDArray[np.int_] = slice(None)) -> FloatArray:
        """Return the sums (M,) of SErrMin of models F (M, 3, 3) over a block of smears, each at most a limit.

        Few models at a time, whose residuals stay in the processor's cache.
        """
        f = _entries(F)
        rows = [np.asarray(row, self._features[0].dtype) for row in (*_forms(f), *_gradients(f, f))]
        columns = [features[:, block] for features in self._features]
        total, step = np.empty(len(F), rows[0].dtype), max(CHUNK // max(columns[0].shape[1], 1), 1)
        for start in range(0, len(F), step):
            part = slice(start, start + step)
            q, skew, even, odd = (row[:, part].T @ column for row, column in zip(rows, columns, strict=True))
            least = np.minimum(_ratio(q + skew, even + odd), _ratio(q - skew, even - odd))
            total[part] = np.minimum(least, least.dtype.type(limit), out=least).sum(axis=1)
        return total

    def _algebraic(self, f: Array) -> Array:
        """Return y^T F x and x^T F y, (k, 2, N), of entries (3, 3, k)."""
        q, skew = (row.T @ part for row, part in zip(_forms(f), self._features[:2], strict=True))
        return np.stack([q + skew, q - skew], axis=1)

    def _squared_gradient(self, f: Array, t: Array) -> Array:
        """Return E +- O, (k, 2, N), of entries (3, 3, k), or half their change along others t (3, 3, k)."""
        even, odd = (row.T @ part for row, part in zip(_gradients(f, t), self._features[2:], strict=True))
        return np.stack([even + odd, even - odd], axis=1)


def _entries(F: Array) -> Array:
    """Return matrices (3, 3) or (M, 3, 3) as (3, 3, M)."""
    return np.ascontiguousarray(F.reshape(-1, 9).T).reshape(3, 3, -1)


def _forms(f: Array) -> tuple[Array, Array]:
    """Return the coefficients of q (6, M) and l (3, M): S, the upper half, and a, of entries (3, 3, M)."""
    half = 0.5 * (f + np.swapaxes(f, 0, 1))
    skew = 0.5 * np.stack([f[2, 1] - f[1, 2], f[0, 2] - f[2, 0], f[1, 0] - f[0, 1]])
    return half[UPPER], skew


def _gradients(f: Array, t: Array) -> tuple[Array, Array]:
    """Return the coefficients of E (6, M) and O (6, M) for f = t, else half their derivatives along t."""
    gram1 = f[0, :, None] * t[0] + f[1, :, None] * t[1]
    gram2 = f[:, None, 0] * t[:, 0] + f[:, None, 1] * t[:, 1]
    both, difference = gram1 + gram2, gram2 - gram1
    both, difference = (0.5 * (g + np.swapaxes(g, 0, 1)) for g in (both, difference))
    return both[UPPER], difference[:2].reshape(6, -1)


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
