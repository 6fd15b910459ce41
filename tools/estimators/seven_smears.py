"""Every F of seven smears whose ends have no order, exactly: a baseline, which no command needs.

With F = S + [a]x and its features Q (7x6) and L (7x3), as in `epipolar`, and signs sigma (one per smear, the
unknown orders), the seven equations are Q vec(S) = -diag(sigma) L a. Q does not contain the signs, so all
sign patterns share one factorisation. With n the left null vector of Q, (n o sigma)^T L a = 0 leaves a plane
of vectors a, S follows by the pseudo-inverse of Q, and det F = 0 is one cubic: one or three real F per
pattern. Flipping every sign transposes F, so sigma_1 = +1 is enough.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import (
    apply_similarity,
    cross_matrix,
    quadratic_features,
    shared_normalisation,
    symmetric_from_vector,
)
from blur2view.geometry.rotation import perpendicular

SAMPLE_SIZE = 7
ALL_SIGNS: Array = np.array(list(itertools.product([1.0], *[[1.0, -1.0]] * 6)))  # (64, 7)
DOUBLE_ROOT_SLACK = 1e-6  # imaginary part, relative, of a double root that is rounded
# The nine entries of S + [a]x, row by row, from (S11, S12, S13, S22, S23, S33, a1, a2, a3).
ENTRIES: Array = np.concatenate(
    [symmetric_from_vector(np.eye(6)).reshape(6, 9), cross_matrix(np.eye(3)).reshape(3, 9)]
).T  # (9, 9)


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
    pencil = _pencils(apply_similarity(T[:, None], ends), ALL_SIGNS.T)  # (B, 9, 2, P)
    one, other = np.einsum("ek,bkgp->gbpe", ENTRIES, pencil).reshape(2, -1, 3, 3)  # (B P, 3, 3) each
    at = [np.linalg.det(matrix) for matrix in (one, other, one + other, one - other)]
    even, odd = 0.5 * (at[2] + at[3]), 0.5 * (at[2] - at[3])  # c0 + c2, c1 + c3
    index, alpha, beta = real_roots(np.stack([at[0], odd - at[1], even - at[0], at[1]], axis=-1))
    F = alpha[:, None, None] * one[index] + beta[:, None, None] * other[index]
    scale = T[index // len(ALL_SIGNS)]
    F = np.swapaxes(scale, 1, 2) @ F @ scale
    unit: Array = F / np.maximum(np.linalg.norm(F, axis=(1, 2), keepdims=True), TINY)
    return unit


def _pencils(ends: Array, signs: Array) -> Array:
    """Return two (S, a) that span all solutions, (B, 9, 2, P), for every sample and pattern."""
    q, skew = quadratic_features(ends)  # (B, 7, 6), (B, 7, 3)
    orthogonal, triangle = np.linalg.qr(q, mode="complete")
    diagonal = np.abs(np.diagonal(triangle[:, : SAMPLE_SIZE - 1], axis1=1, axis2=2))
    triangle[diagonal.min(axis=1) < 1e-13 * diagonal.max(axis=1)] = np.eye(7, 6)  # rank-deficient: no meaning
    inverse = np.linalg.solve(triangle[:, :6], np.swapaxes(orthogonal[:, :, :6], 1, 2))  # (B, 6, 7)
    normal = np.swapaxes(orthogonal[:, :, 6, None] * skew, 1, 2) @ signs  # (B, 3, P)
    basis = perpendicular(*np.moveaxis(normal, 1, 0))  # two times three of (B, P)
    axes = np.stack([np.stack(vector, axis=1) for vector in basis], axis=2)  # (B, 3, 2, P)
    batch, _, _, patterns = axes.shape
    along = (skew @ axes.reshape(batch, 3, -1)).reshape(batch, 7, 2, patterns) * signs[:, None]
    S = -(inverse @ along.reshape(batch, 7, -1)).reshape(batch, 6, 2, patterns)
    return np.concatenate([S, axes], axis=1)


def real_roots(coefficients: Array) -> tuple[NDArray[np.intp], Array, Array]:
    """Return the real roots (alpha : beta) of cubics c0 alpha^3 + c1 alpha^2 beta + ... (n, 4).

    The number of its cubic, alpha and beta of each root, (m,); a cubic of zeros has none.
    """
    flip = np.abs(coefficients[:, 3]) > np.abs(coefficients[:, 0])
    c = np.where(flip[:, None], coefficients[:, ::-1], coefficients)
    numbers = np.flatnonzero(np.abs(c[:, 0]) > TINY)
    companion = np.zeros((len(numbers), 3, 3))
    companion[:, [1, 2], [0, 1]] = 1
    companion[:, :, 2] = -c[numbers, :0:-1] / c[numbers, :1]
    roots = np.linalg.eigvals(companion)
    which, k = np.nonzero(np.abs(roots.imag) <= DOUBLE_ROOT_SLACK * np.abs(roots))
    index, root = numbers[which], roots[which, k].real
    return index, np.where(flip[index], 1.0, root), np.where(flip[index], root, 1.0)
