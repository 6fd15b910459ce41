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

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import cross_matrix, quadratic_features

SAMPLE_SIZE = 7
ALL_SIGNS: Array = np.array(list(itertools.product([1.0], *[[1.0, -1.0]] * 6)))  # (64, 7)
DOUBLE_ROOT_SLACK = 1e-9  # a double root, rounded, must not count as a complex pair


def symmetric_from_vector(vector: Array) -> Array:
    """Return the symmetric (..., 3, 3) of (S11, S12, S13, S22, S23, S33), shape (..., 6)."""
    full: Array = vector[..., [0, 1, 2, 1, 3, 4, 2, 4, 5]]
    return full.reshape(*vector.shape[:-1], 3, 3)


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
        Candidates of unit norm and rank 2, about 155 a sample (0.06 ms on one core); the transposes are left
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
    batch, _, _, patterns = pencil.shape
    separate = np.ascontiguousarray(pencil.transpose(2, 1, 0, 3)).reshape(2, 9, batch * patterns)
    alpha, beta = homogeneous_cubic_roots(_determinant_cubic(separate))  # (3, B P)
    # T^T F T is linear in F: it is done once for the two ends of a pencil, not for every root
    carry = np.swapaxes(T, 1, 2)[:, :, None, :, None] * np.swapaxes(T, 1, 2)[:, None, :, None, :]
    pixels = np.swapaxes(pencil.reshape(batch, 9, -1), 1, 2) @ np.swapaxes(
        carry.reshape(batch, 9, 9) @ ENTRIES, 1, 2
    )
    one, other = np.swapaxes(pixels.reshape(batch, 2, patterns, 9), 0, 1).reshape(2, -1, 9)
    root, index = np.nonzero(np.isfinite(alpha))
    F = alpha[root, index, None] * one[index] + beta[root, index, None] * other[index]
    F /= np.maximum(np.sqrt(np.einsum("mk,mk->m", F, F)), TINY)[:, None]
    return F.reshape(-1, 3, 3)


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


def _determinant_cubic(pencil: Array) -> Array:
    """Return coefficients (4, n) of det F(alpha, beta) in alpha^3 ... beta^3, for two (S, a), (2, 9, n)."""
    one, other = pencil
    at = [_determinant(*value) for value in (one, other, one + other, one - other)]
    even, odd = 0.5 * (at[2] + at[3]), 0.5 * (at[2] - at[3])  # c0 + c2, c1 + c3
    return np.stack([at[0], odd - at[1], even - at[0], at[1]])


def _determinant(
    s11: Array, s12: Array, s13: Array, s22: Array, s23: Array, s33: Array, x: Array, y: Array, z: Array
) -> Array:
    """Return det(S + [a]x) = det S + a^T S a."""
    det = s11 * (s22 * s33 - s23 * s23) - s12 * (s12 * s33 - s23 * s13) + s13 * (s12 * s23 - s22 * s13)
    row1, row2, row3 = s11 * x + s12 * y + s13 * z, s12 * x + s22 * y + s23 * z, s13 * x + s23 * y + s33 * z
    total: Array = det + x * row1 + y * row2 + z * row3
    return total


def homogeneous_cubic_roots(coefficients: Array) -> tuple[Array, Array]:
    """Return real roots (alpha : beta) of c0 alpha^3 + c1 alpha^2 beta + c2 alpha beta^2 + c3 beta^3.

    Of coefficients (4, ...): alpha and beta (3, ...), of which the larger is 1 in most; NaN where a root is
    complex, and all NaN for an all-zero cubic.
    """
    flip = np.abs(coefficients[3]) > np.abs(coefficients[0])
    c0, c1, c2, c3 = np.where(flip, coefficients[::-1], coefficients)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        roots = _monic_cubic_roots(c1 / c0, c2 / c0, c3 / c0)
    roots[~np.isfinite(roots)] = np.nan
    one = np.where(np.isnan(roots), np.nan, 1.0)
    return np.where(flip, one, roots), np.where(flip, roots, one)


def _monic_cubic_roots(a: Array, b: Array, c: Array) -> Array:
    """Return real roots (3, ...) of x^3 + a x^2 + b x + c, polished; NaN where complex (Viete, Cardano)."""
    q, r = (a * a - 3 * b) / 9, (a * (2 * a * a - 9 * b) + 27 * c) / 54
    q_cubed = np.maximum(q, 0.0) ** 3
    three = (q >= 0) & (r * r <= q_cubed * (1 + DOUBLE_ROOT_SLACK))
    angle = np.arccos(np.clip(r / np.sqrt(np.maximum(q_cubed, TINY * TINY)), -1, 1)) / 3
    large = -np.copysign(np.cbrt(np.abs(r) + np.sqrt(np.maximum(r * r - q * q * q, 0.0))), r)
    single = large + np.where(large == 0, 0.0, q / large)
    height = -2 * np.sqrt(np.maximum(q, 0.0))
    roots = (
        np.stack(
            [
                np.where(three, height * np.cos(angle), single),
                np.where(three, height * np.cos(angle + 2 * np.pi / 3), np.nan),
                np.where(three, height * np.cos(angle - 2 * np.pi / 3), np.nan),
            ]
        )
        - a / 3
    )
    for _ in range(2):  # Newton: closed forms lose digits where roots differ in size
        value, slope = ((roots + a) * roots + b) * roots + c, (3 * roots + 2 * a) * roots + b
        better = roots - value / slope
        after = ((better + a) * better + b) * better + c
        roots = np.where(np.abs(after) < np.abs(value), better, roots)
    return roots


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


def perpendicular(x: Array, y: Array, z: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Return two orthonormal vectors perpendicular to vectors, all by coordinates.

    References
    ----------
    Duff et al., Building an Orthonormal Basis, Revisited, JCGT 6(1), 2017.
    """
    norm = np.maximum(np.sqrt(x * x + y * y + z * z), TINY)
    x, y, z = x / norm, y / norm, z / norm
    sign = np.copysign(1.0, z)
    scale = -1.0 / (sign + z)
    product = x * y * scale
    first = 1.0 + sign * x * x * scale, sign * product, -sign * x
    return first, (product, sign + y * y * scale, -y)
