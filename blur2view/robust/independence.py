"""How many smears err independently of each other, from residuals that neighbours share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import homogeneous
from blur2view.robust.problem import SmearProblem

BLOCKS = 5  # along the longer side, in which errors are compared
REACH, BINS = 0.3, 12  # of the autocorrelation: distances up to this share of the picture's size
PAIRED = 500  # smears at least that are paired for it, if there are as many


def cells(middle: Array, count: int) -> NDArray[np.int_]:
    """Return the square cell (N,) of every point, ``count`` along the longer side of their extent."""
    side = np.ptp(middle, axis=0).max() / count + TINY
    index: NDArray[np.int_] = np.floor((middle - middle.min(axis=0)) / side).astype(int) @ np.array(
        [1, count + 1]
    )
    return index


def independence(values: Array, used: NDArray[np.bool_], middle: Array) -> float:
    """Return the share of independent values, from 1 / (values per block) to 1: how little neighbours agree.

    Parameters
    ----------
    values : ndarray of shape (K, N)
        K kinds of residuals of N smears, in standard deviations.
    used : ndarray of bool, shape (N,)
    middle : ndarray of shape (N, 2)
        Midpoints. Within blocks of a fifth of their extent residuals are summed: the sum of m residuals of
        variance v has variance m v if they are independent, m^2 v if they agree.
    """
    cell = cells(middle, BLOCKS)
    kept = np.where(used, values, 0.0)
    sums = np.stack([np.bincount(cell, weights=row) for row in kept])
    return 1 / max(float((sums**2).sum()) / max(float((kept**2).sum()), TINY), 1.0)


def coherent_residuals(problem: SmearProblem, F: Array) -> Array:
    """Return residuals (N,), in sigmas, whose signs agree where neighbouring smears share an error.

    Every displacement is directed to run along its epipolar line, away from or towards the epipole; its
    residual across the line is then sign(l) (|l| - |q|).
    """
    both = problem.weighted.residuals(F)
    line = homogeneous(problem.ends.mean(axis=1)) @ F.T
    d = problem.ends[:, 1] - problem.ends[:, 0]
    along = d[:, 0] * line[:, 1] - d[:, 1] * line[:, 0]
    skew, symmetric = 0.5 * (both.forward - both.backward), 0.5 * (both.forward + both.backward)
    signed: Array = np.sign(along) * np.sign(skew) * (np.abs(skew) - np.abs(symmetric))
    return signed


def independent_count(problem: SmearProblem, F: Array, cutoff: float) -> float:
    """Return the effective number of independent smears, by the residuals of F (`independence`)."""
    residual = coherent_residuals(problem, F)
    share = independence(residual[None], np.abs(residual) < cutoff, problem.ends.mean(axis=1))
    return len(residual) * share


def autocorrelation(residual: Array, points: Array) -> tuple[float, float]:
    """Return the autocorrelation of residuals near distance zero, and the distance at which it halves.

    Unlike `independence` it measures how far errors reach, at the price of all pairs of PAIRED smears.

    Parameters
    ----------
    residual : ndarray of shape (N,)
        In standard deviations; cut at 3.
    points : ndarray of shape (N, 2)
    """
    thinned = slice(None, None, max(1, len(residual) // PAIRED))
    value, middle = np.clip(residual[thinned], -3, 3), points[thinned]
    one, other = np.triu_indices(len(value), 1)
    distance = np.linalg.norm(middle[one] - middle[other], axis=1)
    width = REACH * float(np.sqrt(np.prod(np.ptp(middle, axis=0)))) / BINS
    bins = np.minimum((distance / max(width, TINY)).astype(int), BINS)
    pairs = np.maximum(np.bincount(bins, minlength=BINS + 1), 1)
    products = np.bincount(bins, weights=value[one] * value[other], minlength=BINS + 1)
    curve = (products / pairs)[:BINS] / max(float((value**2).mean()), TINY)
    below = np.flatnonzero(curve < 0.5 * curve[0])
    return float(np.clip(curve[0], 0, 1)), float((below[0] if len(below) else BINS) + 0.5) * width
