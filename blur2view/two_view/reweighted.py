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
        Weighs the first round; without it all points have the same weight.
    prior : (ndarray, ndarray), optional
        Expectation (k,) and precision (k,) of the motion, where residuals have the deviation ``scale``.
    """
    flat = rows.reshape(*rows.shape[:-2], -1)  # (..., k, d N)
    none = np.zeros(rows.shape[-3])
    expected, precision = (none, none) if prior is None else prior
    weight = np.ones((*rows.shape[:-3], rows.shape[-1]))
    if start is not None:
        weight = _cauchy(_missed(start, flat, flow), scale)
    for _ in range(steps):
        motion = _solved(flat, flow, weight, expected, precision)
        missed = _missed(motion, flat, flow)
        weight = _cauchy(missed, scale)
    return motion, missed


def _solved(flat: Array, flow: Array, weight: Array, expected: Array, precision: Array) -> Array:
    """Return the motions (..., k) of rows (..., k, d N), flow (..., d, N), weights (..., N) and a prior."""
    weighted = flat * np.concatenate([weight] * flow.shape[-2], axis=-1)[..., None, :]
    normal = weighted @ np.swapaxes(flat, -1, -2)
    ridge = RIDGE * np.diagonal(normal, axis1=-2, axis2=-1) + precision + TINY
    right = (weighted @ flow.reshape(*flow.shape[:-2], -1, 1))[..., 0] + precision * expected
    damped = normal + ridge[..., None] * np.eye(ridge.shape[-1])
    return np.asarray(np.linalg.solve(damped, right[..., None])[..., 0])


def _missed(motion: Array, flat: Array, flow: Array) -> Array:
    """Return lengths of the residuals (..., N) of motions (..., k), from rows (..., k, d N)."""
    return np.asarray(np.linalg.norm((motion[..., None, :] @ flat).reshape(flow.shape) - flow, axis=-2))


def _cauchy(missed: Array, scale: Callable[[Array], Array | float]) -> Array:
    """Return the weights (..., N) of residuals of these lengths: 1 / scale^2 where they are zero."""
    weight: Array = 1 / (np.asarray(scale(missed)) ** 2 + missed**2)
    return weight
