"""Every F of seven smears whose ends have no order, exactly: a baseline, which no command needs.

With F = S + [a]x and its features Q (7x6) and L (7x3), as in `epipolar`, and signs sigma (one per smear, the
unknown orders), the seven equations are Q vec(S) + diag(sigma) L a = 0. For each pattern of signs they leave
a pencil of F, in which det F = 0 is one cubic: one or three real F. Flipping every sign transposes F, so
sigma_1 = +1 is enough.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import cross_matrix, denormalise, quadratic_features

SAMPLE_SIZE = 7
ALL_SIGNS: Array = np.array(list(itertools.product([1.0], *[[1.0, -1.0]] * 6)))  # (64, 7)
DOUBLE_ROOT_SLACK = 1e-6  # imaginary part, relative, of a double root that is rounded


def symmetric_from_vector(vector: Array) -> Array:
    """Return the symmetric (..., 3, 3) of (S11, S12, S13, S22, S23, S33), shape (..., 6)."""
    full: Array = vector[..., [0, 1, 2, 1, 3, 4, 2, 4, 5]]
    return full.reshape(*vector.shape[:-1], 3, 3)


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
    q, skew = quadratic_features(apply_similarity(T[:, None], ends))  # (B, 7, 6), (B, 7, 3)
    skew = skew[:, None] * ALL_SIGNS[..., None]  # (B, 64, 7, 3)
    rows = np.concatenate([np.broadcast_to(q[:, None], (*skew.shape[:3], 6)), skew], axis=-1)
    pencil = np.linalg.svd(rows)[2][..., 7:, :].reshape(-1, 2, 9)  # (64 B, 2, 9)
    one, other = np.moveaxis(symmetric_from_vector(pencil[..., :6]) + cross_matrix(pencil[..., 6:]), 1, 0)
    index, root = real_roots(one, other)
    return denormalise(root[:, None, None] * one[index] + other[index], T[index // len(ALL_SIGNS)])


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
    real: Array = np.asarray(roots[which, k].real, float)
    return numbers[which], real


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
