"""Every F of seven smears whose ends have no order, exactly: a baseline, which no command needs.

Each of the 2^7 ways to order the ends leaves seven linear equations ``points2^T F points1 = 0``, hence a
pencil of F, in which det F = 0 is one cubic: one or three real F. Exchanging all ends transposes F, so the
first smear keeps its order.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import denormalise, homogeneous

SAMPLE_SIZE = 7
SWAPPED: NDArray[np.bool_] = np.array(list(itertools.product([False], *[[False, True]] * 6)))  # (64, 7)
DOUBLE_ROOT_SLACK = 1e-6  # imaginary part, relative, of a double root that is rounded


def solve_seven_smears(ends: Array) -> Array:
    """Return every F that seven unordered smears admit, for many samples at once.

    Parameters
    ----------
    ends : ndarray of shape (B, 7, 2, 2)
        B samples of seven smears, pixels.

    Returns
    -------
    ndarray of shape (M, 3, 3)
        Candidates of unit norm and rank 2, about 155 a sample; the transposes are left
        out. A degenerate sample (coincident points, midpoints on a conic) gives none, or meaningless ones.

    Raises
    ------
    ValueError
        If the shape is not as above.
    """
    ends = np.asarray(ends, float)
    if ends.ndim != 4 or ends.shape[1:] != (SAMPLE_SIZE, 2, 2):
        raise ValueError(f"ends must have shape (B, 7, 2, 2), got {ends.shape}")
    T = shared_normalisation(ends)  # (B, 3, 3)
    kept, swapped = (rows[:, None] for rows in constraint_rows(apply_similarity(T[:, None], ends)))
    rows = np.where(SWAPPED[..., None], swapped, kept)  # (B, 64, 7, 9)
    pencil = np.linalg.svd(rows)[2][..., SAMPLE_SIZE:, :].reshape(-1, 2, 3, 3)
    one, other = pencil[:, 0], pencil[:, 1]
    index, root = real_roots(one, other)
    return denormalise(root[:, None, None] * one[index] + other[index], T[index // len(SWAPPED)])


def constraint_rows(ends: Array) -> tuple[Array, Array]:
    """Return what ``points2^T F points1`` is of F's entries, row by row, for both orders of smears.

    Two of (..., 9) of ends (..., 2, 2).
    """
    x, y = homogeneous(ends[..., 0, :]), homogeneous(ends[..., 1, :])
    products = np.stack([y[..., :, None] * x[..., None, :], x[..., :, None] * y[..., None, :]])
    forward, backward = products.reshape(2, *ends.shape[:-2], 9)
    return forward, backward


def real_roots(one: Array, other: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the number of its pencil and r, (m,), of every real r with det(r one + other) = 0, (n, 3, 3)."""
    c3, c0, plus, minus = (np.linalg.det(matrix) for matrix in (one, other, one + other, other - one))
    c2, c1 = 0.5 * (plus + minus) - c0, 0.5 * (plus - minus) - c3
    numbers = np.flatnonzero(np.abs(c3) > TINY)
    companion = np.zeros((len(numbers), 3, 3))
    companion[:, [1, 2], [0, 1]] = 1
    companion[:, :, 2] = -np.stack([c0, c1, c2], axis=1)[numbers] / c3[numbers, None]
    roots = np.linalg.eigvals(companion)
    which, k = np.nonzero(np.abs(roots.imag) <= DOUBLE_ROOT_SLACK * np.abs(roots))
    return numbers[which], np.asarray(roots[which, k].real, float)


def shared_normalisation(ends: Array) -> Array:
    """Return one similarity T (..., 3, 3) of ends (..., N, 2, 2): centroid to 0, mean distance to sqrt(2).

    Two different ones, as for ordered matches, would break the symmetry of swapping the ends of a smear.
    Coincident points give a pure shift.
    """
    points = ends.reshape(*ends.shape[:-3], -1, 2)
    centre = points.mean(axis=-2)
    spread = np.linalg.norm(points - centre[..., None, :], axis=-1).mean(axis=-1)
    scale = np.where(spread > TINY, np.sqrt(2.0) / np.maximum(spread, TINY), 1.0)
    T = np.zeros((*centre.shape[:-1], 3, 3))
    T[..., 0, 0] = T[..., 1, 1] = scale
    T[..., :2, 2] = -scale[..., None] * centre
    T[..., 2, 2] = 1.0
    return T


def apply_similarity(T: Array, points: Array) -> Array:
    """Return pixels (..., K, 2) under scale-and-shift similarities T (..., 3, 3); leading axes broadcast."""
    return points * T[..., 0, 0][..., None, None] + T[..., None, :2, 2]
