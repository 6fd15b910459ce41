"""What neighbouring smears' errors have in common: the one place where blocks are the unit of evidence.

Residuals show errors that are alike over a block of the picture: how many smears are independent, and how
much the sums of gradients scatter. Errors that vary slowly over the whole picture leave no residuals, for the
geometry takes them up; they are as large as the smears' standard deviations state (`slow_errors`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import homogeneous
from blur2view.robust.problem import SmearProblem

ALIKE = 0.5  # share of independent smears below which neighbours err alike
BLOCKS = 5  # along the longer side, in which errors are alike: about 100 px of a picture of 640x480


def cells(middle: Array, count: int) -> NDArray[np.int_]:
    """Return the square cell (N,) of every point, ``count`` along the longer side of their extent."""
    side = np.ptp(middle, axis=0).max() / count + TINY
    index: NDArray[np.int_] = np.floor((middle - middle.min(axis=0)) / side).astype(int) @ np.array(
        [1, count + 1]
    )
    return index


def block_sums(values: Array, middle: Array) -> Array:
    """Return the sums (K, B) of K kinds of values (K, N) over the blocks of the midpoints (N, 2)."""
    block = cells(middle, BLOCKS)
    occupied = np.bincount(block) > 0
    return np.stack([np.bincount(block, weights=row)[occupied] for row in values])


def block_scatter(gradient: Array, middle: Array) -> Array:
    """Return the covariance (k, k) of a summed gradient whose terms (k, N) err alike in blocks.

    References
    ----------
    Liang and Zeger, Longitudinal data analysis using generalized linear models, Biometrika 73(1), 1986.
    """
    sums = block_sums(gradient, middle)
    parameters, blocks = sums.shape
    scatter: Array = sums @ sums.T * (blocks / max(blocks - parameters, 1))
    return scatter


def slow_errors(problem: SmearProblem) -> Array:
    """Return errors (6, N, 2) of the displacements that vary slowly over the picture, each of one deviation.

    Directions and lengths err alike everywhere, or in proportion to x or y, by what the standard deviations
    as given state of the median smear. Of the network's errors on 25 rendered rotations (`failure_scenes`,
    median deviations) directions err so by 0.7, 1.9 and 2.7 degrees, lengths by 2, 3 and 5 %, where 2.4
    degrees and 4 % are stated; on 25 general motions by 1.2, 1.8 and 3.3 degrees, 6, 11 and 7 % (4 and 7 %).
    """
    middle, along = problem.ends.mean(axis=1), problem.ends[:, 1] - problem.ends[:, 0]
    stated = 2**0.5 * float(np.median(problem.sigma_px / (problem.length_px + TINY))) / problem.scale
    half = 0.5 * float(np.ptp(middle, axis=0).max()) + TINY
    modes = np.column_stack([np.ones(len(middle)), (middle - np.median(middle, axis=0)) / half]).T
    both = np.stack([along, along[:, ::-1] * [-1.0, 1.0]])  # of lengths, of directions
    errors: Array = stated * (modes[:, None, :, None] * both).reshape(-1, *along.shape)
    return errors


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
    kept = np.where(used, values, 0.0)
    sums = block_sums(kept, middle)
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
