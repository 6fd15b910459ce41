"""Exact minimal solver: F from seven smears whose ends have no order.

With F = S + [a]x and its features Q (7x6) and L (7x3), as in `epipolar`, and signs sigma (one per smear, the
unknown orders), the seven equations are Q vec(S) = -diag(sigma) L a. Q does not contain the signs, so all
sign patterns share one factorisation. With n the left null vector of Q, (n o sigma)^T L a = 0 leaves a plane
of vectors a, S follows by the pseudo-inverse of Q, and det F = 0 is one cubic: one or three real F per
pattern. Flipping every sign transposes F, so sigma_1 = +1 is enough.
"""

from __future__ import annotations

import itertools

import numpy as np

from blur2view.epipolar import (
    TINY,
    Array,
    apply_similarity,
    denormalise,
    join_symmetric_skew,
    quadratic_features,
    shared_normalisation,
    symmetric_from_vector,
)

SAMPLE_SIZE = 7
ALL_SIGNS: Array = np.array(list(itertools.product([1.0], *[[1.0, -1.0]] * 6)))  # (64, 7)
DOUBLE_ROOT_SLACK = 1e-9  # a double root, rounded, must not count as a complex pair
CHUNK = 32  # samples at once; 0.11 ms a sample on one core (0.55 one by one, 0.14 all 1000)


def solve_seven_smears(ends: Array, signs: Array | None = None) -> tuple[Array, np.ndarray]:
    """Give every F that seven unordered smears admit, for many samples at once.

    Parameters
    ----------
    ends : ndarray of shape (B, 7, 2, 2)
        B samples of seven smears, pixels.
    signs : ndarray of shape (P, 7), optional
        The sign patterns to try, +1 where ends[:, 0] is the open end; default all 64 with the first +1.
        Fewer when orders are known to agree within components.

    Returns
    -------
    F : ndarray of shape (M, 3, 3)
        Candidates of unit norm and rank 2, about 155 a sample; the transposes are left out.
    sample : ndarray of int, shape (M,)
        The sample each candidate came from. A degenerate sample (coincident points, midpoints on a conic)
        gives none, or meaningless ones.

    Raises
    ------
    ValueError
        If the shapes are not as above.
    """
    ends = np.asarray(ends, float)
    signs = ALL_SIGNS if signs is None else np.asarray(signs, float)
    if ends.ndim != 4 or ends.shape[1:] != (SAMPLE_SIZE, 2, 2):
        raise ValueError(f"ends must have shape (B, 7, 2, 2), got {ends.shape}")
    if signs.ndim != 2 or signs.shape[1] != SAMPLE_SIZE:
        raise ValueError(f"signs must have shape (P, 7), got {signs.shape}")
    parts = [_solve_chunk(ends[i : i + CHUNK], signs) for i in range(0, len(ends), CHUNK)]
    if not parts:
        return np.zeros((0, 3, 3)), np.zeros(0, int)
    sample = np.concatenate([part[1] + CHUNK * i for i, part in enumerate(parts)])
    return np.concatenate([part[0] for part in parts]), sample


def _solve_chunk(ends: Array, signs: Array) -> tuple[Array, np.ndarray]:
    T = shared_normalisation(ends)  # (B, 3, 3)
    normalised = apply_similarity(T[:, None], ends)
    S, a = _pencils(normalised, signs)  # (2, B, P, 6), (2, B, P, 3)
    alpha, beta = homogeneous_cubic_roots(_determinant_cubic(S, a))  # (3, B, P)
    root, sample, pattern = np.nonzero(np.isfinite(alpha))
    alpha, beta = alpha[root, sample, pattern, None], beta[root, sample, pattern, None]
    vector = alpha * S[0, sample, pattern] + beta * S[1, sample, pattern]
    axis = alpha * a[0, sample, pattern] + beta * a[1, sample, pattern]
    F = denormalise(join_symmetric_skew(symmetric_from_vector(vector), axis), T[sample])
    return F, sample


def _pencils(ends: Array, signs: Array) -> tuple[Array, Array]:
    """Give, per sample and pattern, two (S, a) that span all solutions of the linear equations."""
    q, skew = quadratic_features(ends)  # (B, 7, 6), (B, 7, 3)
    orthogonal, triangle = np.linalg.qr(q, mode="complete")
    diagonal = np.abs(np.diagonal(triangle[:, : SAMPLE_SIZE - 1], axis1=1, axis2=2))
    triangle[diagonal.min(axis=1) < 1e-13 * diagonal.max(axis=1)] = np.eye(7, 6)  # rank-deficient: no meaning
    inverse = np.linalg.solve(triangle[:, :6], np.swapaxes(orthogonal[:, :, :6], 1, 2))  # (B, 6, 7)
    normal = signs @ (orthogonal[:, :, 6, None] * skew)  # (B, P, 3)
    basis = plane_basis(normal)  # (2, B, P, 3)
    right = signs * (basis @ np.swapaxes(skew, 1, 2))  # (2, B, P, 7)
    return -(right @ np.swapaxes(inverse, 1, 2)), basis


def plane_basis(normal: Array) -> Array:
    """Two orthonormal vectors perpendicular to each (unnormalised) vector, shape (..., 3) to (2, ..., 3).

    References
    ----------
    Duff et al., Building an Orthonormal Basis, Revisited, JCGT 6(1), 2017.
    """
    x, y, z = np.moveaxis(normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), TINY), -1, 0)
    sign = np.copysign(1.0, z)
    scale = -1.0 / (sign + z)
    product = x * y * scale
    first = np.stack([1.0 + sign * x * x * scale, sign * product, -sign * x], axis=-1)
    second = np.stack([product, sign + y * y * scale, -y], axis=-1)
    return np.stack([first, second])


def _determinant_cubic(S: Array, a: Array) -> Array:
    """Coefficients (4, ...) of det F(alpha, beta) = det S + a^T S a in alpha^3 ... beta^3."""
    value = np.moveaxis(S, -1, 1), np.moveaxis(a, -1, 1)  # (2, 6, ...), (2, 3, ...)
    at = [
        _determinant(alpha * value[0][0] + beta * value[0][1], alpha * value[1][0] + beta * value[1][1])
        for alpha, beta in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0))
    ]
    even, odd = 0.5 * (at[2] + at[3]), 0.5 * (at[2] - at[3])  # c0 + c2, c1 + c3
    return np.stack([at[0], odd - at[1], even - at[0], at[1]])


def _determinant(S: Array, a: Array) -> Array:
    """Evaluate det(S + [a]x) = det S + a^T S a for S (6, ...) and a (3, ...)."""
    s11, s12, s13, s22, s23, s33 = S
    x, y, z = a
    det = s11 * (s22 * s33 - s23 * s23) - s12 * (s12 * s33 - s23 * s13) + s13 * (s12 * s23 - s22 * s13)
    row1, row2, row3 = s11 * x + s12 * y + s13 * z, s12 * x + s22 * y + s23 * z, s13 * x + s23 * y + s33 * z
    total: Array = det + x * row1 + y * row2 + z * row3
    return total


def homogeneous_cubic_roots(coefficients: Array) -> tuple[Array, Array]:
    """Real roots (alpha : beta) of c0 alpha^3 + c1 alpha^2 beta + c2 alpha beta^2 + c3 beta^3.

    Parameters
    ----------
    coefficients : ndarray of shape (4, ...)

    Returns
    -------
    alpha, beta : ndarray of shape (3, ...)
        The larger of the two is 1 in most; NaN where a root is complex. All NaN for an all-zero cubic.
    """
    flip = np.abs(coefficients[3]) > np.abs(coefficients[0])
    c0, c1, c2, c3 = np.where(flip, coefficients[::-1], coefficients)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        roots = _monic_cubic_roots(c1 / c0, c2 / c0, c3 / c0)
    roots[~np.isfinite(roots)] = np.nan
    one = np.where(np.isnan(roots), np.nan, 1.0)
    return np.where(flip, one, roots), np.where(flip, roots, one)


def _monic_cubic_roots(a: Array, b: Array, c: Array) -> Array:
    """Real roots (3, ...) of x^3 + a x^2 + b x + c by Viete and Cardano, polished; NaN where complex."""
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
