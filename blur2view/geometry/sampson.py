"""Sampson distances: of ordered matches, of the better order, of many F at once."""

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


class BatchSampson:
    """SErrMin of M models on N smears, with q, l and the gradients' even and odd parts as products.

    With x, y = p -+ s the squared Sampson distance of one order is (q + l)^2 / (E + O) and of the other
    (q - l)^2 / (E - O): E is even, O odd in the exchange of the ends. Work is in float32 (relative errors
    of about 1e-4 of a normalised pixel), so ends (N, 2, 2) should be normalised; results are in squared
    pixels, ``unit_px`` of which are a normalised unit.
    """

    def __init__(self, ends: Array, unit_px: float) -> None:
        q, skew = quadratic_features(ends)
        p, s = ends.mean(axis=1), 0.5 * (ends[:, 1] - ends[:, 0])
        even, odd = _gradient_features(p, s)
        self._features = [
            np.ascontiguousarray(part.T, np.float32) for part in (q * unit_px, skew * unit_px, even, odd)
        ]
        self.count = len(ends)

    def costs(
        self, F: Array, weight: FloatArray, limit: float, block: slice | NDArray[np.int_] = slice(None)
    ) -> FloatArray:
        """Return the sums (M,) of SErrMin times a weight (N,), each at most ``limit``, over a block.

        Of models F (M, 3, 3), few at a time, whose residuals stay in the processor's cache.
        """
        rows, weight = _coefficients(F), weight[block]
        columns = [features[:, block] for features in self._features]
        total, step = np.empty(len(F), np.float32), max(CHUNK // max(len(weight), 1), 1)
        for start in range(0, len(F), step):
            part = slice(start, start + step)
            q, skew, even, odd = (row[:, part].T @ column for row, column in zip(rows, columns, strict=True))
            least = np.minimum(_ratio(q + skew, even + odd), _ratio(q - skew, even - odd))
            least *= weight
            total[part] = np.minimum(least, np.float32(limit), out=least).sum(axis=1)
        return total


def _coefficients(F: Array) -> list[FloatArray]:
    """Return what q, l and the even and odd parts of the gradient are of F (M, 3, 3): (k, M), float32.

    |(F x)_12|^2 = x^T G1 x and |(F^T y)_12|^2 = y^T G2 y; even are entries of G1 + G2, odd of G2 - G1.
    """
    f = np.ascontiguousarray(F.reshape(-1, 9).T).reshape(3, 3, -1)  # (3, 3, M)
    half = 0.5 * (f + np.swapaxes(f, 0, 1))
    skew = 0.5 * np.stack([f[2, 1] - f[1, 2], f[0, 2] - f[2, 0], f[1, 0] - f[0, 1]])
    gram1 = f[0, :, None] * f[0] + f[1, :, None] * f[1]
    gram2 = f[:, None, 0] * f[:, 0] + f[:, None, 1] * f[:, 1]
    even, odd = (gram1 + gram2)[UPPER], (gram2 - gram1)[:2].reshape(6, -1)
    return [np.ascontiguousarray(part, np.float32) for part in (half[UPPER], skew, even, odd)]


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
