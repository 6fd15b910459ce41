"""Iteratively reweighted least squares: the motion that explains most of a flow, which is linear in it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from blur2view.arrays import TINY, Array

RIDGE = 1e-9  # of the normal equations' diagonal, added to it: singular problems have some solution


def reweighted_motion(
    rows: Array,
    flow: Array,
    *,
    steps: int,
    scale: Callable[[Array], Array | float],
    start: Array | None = None,
    ordered: bool = True,
    prior: tuple[Array, Array] | None = None,
) -> tuple[Array, Array]:
    """Return the motion m (..., k) with m @ rows = flow for most points, and lengths of residuals (..., N).

    Found in ``steps`` rounds of Cauchy's weights; leading axes are problems, each solved by itself.

    Parameters
    ----------
    rows : ndarray of shape (..., k, d, N)
        Flow of d components at N points per unit of each of k parameters.
    flow : ndarray of shape (..., d, N)
    scale : callable
        Maps the lengths of the residuals (..., N) to the length of half the weight.
    start : ndarray of shape (..., k), optional
        Weighs the first round if ``ordered``; without it all points have the same weight.
    ordered : bool
        If not, the sign of every flow is unknown (ValueError without a start): it is, anew in every round,
        the one that agrees better with the motion; the start decides the first ones.
    prior : (ndarray, ndarray), optional
        Expectation (k,) and precision (k,) of the motion, where residuals have the deviation ``scale``.
    """
    if start is None and not ordered:
        raise ValueError("signs that are unknown need a start")
    parameters = rows.shape[-3]
    flat = rows.reshape(*rows.shape[:-2], -1)  # (..., k, d N)
    expected, precision = (np.zeros(parameters), np.zeros(parameters)) if prior is None else prior
    motion = np.zeros((*rows.shape[:-3], parameters)) if start is None else start
    weight = np.ones((*rows.shape[:-3], rows.shape[-1]))
    if ordered and start is not None:
        weight = _cauchy(np.linalg.norm(_predicted(motion, flat, flow) - flow, axis=-2), scale)
    missed = weight
    for _ in range(steps):
        sign = np.where((_predicted(motion, flat, flow) * flow).sum(axis=-2, keepdims=True) < 0, -1.0, 1.0)
        signed = flow if ordered else sign * flow
        motion = _solved(flat, signed, weight, expected, precision)
        missed = np.linalg.norm(_predicted(motion, flat, flow) - signed, axis=-2)
        weight = _cauchy(missed, scale)
    return motion, missed


def _solved(flat: Array, signed: Array, weight: Array, expected: Array, precision: Array) -> Array:
    """Return the motions (..., k) of rows (..., k, d N), flow (..., d, N), weights (..., N) and a prior."""
    weighted = flat * np.concatenate([weight] * signed.shape[-2], axis=-1)[..., None, :]
    normal = weighted @ np.swapaxes(flat, -1, -2)
    ridge = RIDGE * np.diagonal(normal, axis1=-2, axis2=-1) + precision + TINY
    right = (weighted @ signed.reshape(*signed.shape[:-2], -1, 1))[..., 0] + precision * expected
    damped = normal + ridge[..., None] * np.eye(ridge.shape[-1])
    return np.asarray(np.linalg.solve(damped, right[..., None])[..., 0])


def _predicted(motion: Array, flat: Array, flow: Array) -> Array:
    """Return the flow (..., d, N) of motions (..., k), from rows (..., k, d N)."""
    predicted: Array = (motion[..., None, :] @ flat).reshape(flow.shape)
    return predicted


def _cauchy(missed: Array, scale: Callable[[Array], Array | float]) -> Array:
    """Return the weights (..., N) of residuals of these lengths: 1 / scale^2 where they are zero."""
    weight: Array = 1 / (np.asarray(scale(missed)) ** 2 + missed**2)
    return weight
