"""Sampson distances: of ordered matches, of the better order, of many F at once, and their derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import homogeneous, quadratic_features, symmetric_skew

FloatArray = NDArray[np.floating[Any]]
UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])


def sampson(F: Array, points1: Array, points2: Array) -> Array:
    """Return the squared Sampson distance of ordered matches to F, in squared pixels.

    Parameters
    ----------
    F : ndarray of shape (..., 3, 3)
    points1, points2 : ndarray of shape (N, 2)

    Returns
    -------
    ndarray of shape (..., N)
        Zero for exact matches, and at a match lying on both epipoles.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd ed., equation 11.9.
    """
    x, y = homogeneous(points1), homogeneous(points2)
    line2 = x @ np.swapaxes(F, -2, -1)  # (..., N, 3)
    line1 = y @ F
    algebraic = (line2 * y).sum(-1)
    gradient = (line2[..., :2] ** 2).sum(-1) + (line1[..., :2] ** 2).sum(-1)
    squared: Array = algebraic**2 / np.maximum(gradient, TINY)
    return squared


def serrmin(F: Array, ends: Array) -> Array:
    """Return SErrMin: the smaller of the squared Sampson distances of the two orders of each smear.

    Parameters
    ----------
    F : ndarray of shape (..., 3, 3)
        F and its transpose give the same values.
    ends : ndarray of shape (N, 2, 2)

    Returns
    -------
    ndarray of shape (..., N)
        Squared pixels.
    """
    one, other = ends[:, 0], ends[:, 1]
    return np.minimum(sampson(F, one, other), sampson(F, other, one))


def swapped_order(F: Array, ends: Array) -> NDArray[np.bool_]:
    """Return the order of each match: True where ``ends[:, 1]`` is the open (first) point under F.

    Parameters
    ----------
    F : ndarray of shape (3, 3)
    ends : ndarray of shape (N, 2, 2)

    Returns
    -------
    ndarray of bool, shape (N,)
        Ties (a pure translation decides nothing) are False. F^T gives the complement except at ties.
    """
    one, other = ends[:, 0], ends[:, 1]
    decided: NDArray[np.bool_] = sampson(F, other, one) < sampson(F, one, other)
    return decided


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
        """Return SErrMin, float32 (M, n), of F (M, 3, 3) on the smears of a block (slice or indices)."""
        S, a = symmetric_skew(F)
        gram1 = np.swapaxes(F[:, :2], 1, 2) @ F[:, :2]  # |(F x)_12|^2 = x^T gram1 x
        gram2 = F[:, :, :2] @ np.swapaxes(F[:, :, :2], 1, 2)
        q = _rows(S[:, UPPER[0], UPPER[1]]) @ self._q[:, block]
        skew = _rows(a) @ self._l[:, block]
        even = _rows((gram1 + gram2)[:, UPPER[0], UPPER[1]]) @ self._even[:, block]
        odd = _rows((gram2 - gram1)[:, :2].reshape(-1, 6)) @ self._odd[:, block]
        return np.minimum(_ratio(q + skew, even + odd), _ratio(q - skew, even - odd))


def _gradient_features(p: Array, s: Array) -> tuple[Array, Array]:
    """Return monomials of p p^T + s s^T and of 2 s p^T, (N, 6), with homogeneous p and s = (su, sv, 0)."""
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


def signed_sampson(F: Array, points1: Array, points2: Array) -> Array:
    """Return signed Sampson distances (N,) to F (3, 3): roots of `sampson.sampson`, with a sign."""
    return residual_parts(F, homogeneous(points1).T, homogeneous(points2).T)[0]


def sampson_jacobian(F: Array, points1: Array, points2: Array) -> Array:
    """Return the derivative (N, 3, 3) of `signed_sampson` in the entries of F."""
    columns = entry_jacobian(F, homogeneous(points1).T, homogeneous(points2).T)
    return columns.T.reshape(-1, 3, 3)


def entry_jacobian(F: Array, x: Array, y: Array) -> Array:
    """Return the derivative (9, N) of the signed Sampson distance for homogeneous x, y (3, N)."""
    residual, line1, line2, root = residual_parts(F, x, y)
    scaled = residual / root  # c / D
    line1[:2] *= scaled
    line2[:2] *= scaled
    line1[2] = line2[2] = 0.0
    along = (y - line2) / root
    jacobian = along[:, None] * x - (y / root)[:, None] * line1
    columns: Array = jacobian.reshape(9, -1)
    return columns


def residual_parts(F: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Return the signed residual (N,), lines in view 1 and 2 (3, N), root of the squared gradient (N,)."""
    line2, line1 = F @ x, F.T @ y
    squared = line2[0] ** 2 + line2[1] ** 2 + line1[0] ** 2 + line1[1] ** 2
    root = np.sqrt(np.maximum(squared, TINY))
    return (line2[0] * y[0] + line2[1] * y[1] + line2[2] * y[2]) / root, line1, line2, root
