"""Fast SErrMin of many F at once: matrix products with features computed once per set of smears."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.epipolar import Array, quadratic_features, symmetric_skew

FloatArray = NDArray[np.floating[Any]]
UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])


class BatchSampson:
    """SErrMin of M models on N smears, with q, l and the gradients' even and odd parts as products.

    With x, y = p -+ s the squared Sampson distance of one order is (q + l)^2 / (E + O) and of the other
    (q - l)^2 / (E - O): E is even, O odd in the exchange of the ends. Work is in float32 (relative errors
    of about 1e-4 of a normalised pixel), so coordinates should be normalised.

    Parameters
    ----------
    ends : ndarray of shape (N, 2, 2)
        Normalised coordinates.
    unit_px : float
        Pixels per normalised unit; results are in squared pixels.
    """

    def __init__(self, ends: Array, unit_px: float) -> None:
        q, skew = quadratic_features(ends)
        p, s = ends.mean(axis=1), 0.5 * (ends[:, 1] - ends[:, 0])
        even, odd = _gradient_features(p, s)
        self._q, self._l = _columns(q * unit_px), _columns(skew * unit_px)
        self._even, self._odd = _columns(even), _columns(odd)
        self.count = len(ends)

    def __call__(self, F: Array, block: slice | NDArray[np.int_] = slice(None)) -> FloatArray:
        """SErrMin, float32 of shape (M, n), of F (M, 3, 3) on the smears of a block (slice or indices)."""
        S, a = symmetric_skew(F)
        gram1 = np.swapaxes(F[:, :2], 1, 2) @ F[:, :2]  # |(F x)_12|^2 = x^T gram1 x
        gram2 = F[:, :, :2] @ np.swapaxes(F[:, :, :2], 1, 2)
        q = _rows(S[:, UPPER[0], UPPER[1]]) @ self._q[:, block]
        skew = _rows(a) @ self._l[:, block]
        even = _rows((gram1 + gram2)[:, UPPER[0], UPPER[1]]) @ self._even[:, block]
        odd = _rows((gram2 - gram1)[:, :2].reshape(-1, 6)) @ self._odd[:, block]
        return np.minimum(_ratio(q + skew, even + odd), _ratio(q - skew, even - odd))


def _gradient_features(p: Array, s: Array) -> tuple[Array, Array]:
    """Monomials of p p^T + s s^T (N, 6) and of 2 s p^T (N, 6), with homogeneous p and s = (su, sv, 0)."""
    u, v, su, sv = p[:, 0], p[:, 1], s[:, 0], s[:, 1]
    one = np.ones_like(u)
    even = [u * u + su * su, 2 * (u * v + su * sv), 2 * u, v * v + sv * sv, 2 * v, one]
    odd = [2 * su * u, 2 * su * v, 2 * su, 2 * sv * u, 2 * sv * v, 2 * sv]
    return np.stack(even, axis=1), np.stack(odd, axis=1)


def _columns(features: Array) -> FloatArray:
    return np.ascontiguousarray(features.T, dtype=np.float32)


def _rows(coefficients: Array) -> FloatArray:
    return np.ascontiguousarray(coefficients, dtype=np.float32)


def _ratio(numerator: FloatArray, gradient: FloatArray) -> FloatArray:
    squared: FloatArray = numerator * numerator
    squared /= np.maximum(gradient, np.float32(1e-20))
    return squared
