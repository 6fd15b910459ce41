"""Hypotheses for the robust loop: starts from seven smears, from three smears and a direction, from two.

Seven smears fix any F exactly, but one wrong smear in seven spoils them, and noise does too. A photograph's
camera is roughly known (square pixels, centred, focal length near the image's width) and turns little
during an exposure; then F = [t]x (I + [w]x) to first order, and for every direction t of a grid three
smears fix w linearly. These starts are approximate; local optimisation makes them exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blur2view.epipolar import TINY, Array, cross_matrix, homogeneous

THREE_SIGNS: Array = np.array([[1.0, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]])
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


def half_sphere(count: int) -> Array:
    """Give unit vectors (count, 3) spread evenly over the half sphere z > 0 (a Fibonacci spiral)."""
    index = np.arange(count)
    z = (index + 0.5) / count
    radius, angle = np.sqrt(1 - z * z), GOLDEN_ANGLE * index
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def weighted_samples(weights: Array, size: int, samples: int, rng: np.random.Generator) -> NDArray[np.int_]:
    """Draw index sets (samples, size) without repetition inside a set, by weight.

    Sets are drawn with repetition; the few that have one are drawn anew without (Gumbel top-k).

    Raises
    ------
    ValueError
        If there are fewer data than ``size``.
    """
    if len(weights) < size:
        raise ValueError(f"need at least {size} data to sample from, got {len(weights)}")
    cumulative = np.cumsum(np.maximum(weights, TINY))
    drawn: NDArray[np.int_] = np.searchsorted(
        cumulative[:-1], rng.random((samples, size)) * cumulative[-1], side="right"
    )
    repeated = (np.diff(np.sort(drawn, axis=1), axis=1) == 0).any(axis=1)
    keys = np.log(np.maximum(weights, TINY)) + rng.gumbel(size=(int(repeated.sum()), len(weights)))
    drawn[repeated] = np.argpartition(-keys, size - 1, axis=1)[:, :size]
    return drawn


def turning_hypotheses(ends: Array, directions: Array, limit: Array, signs: Array | None = None) -> Array:
    """F = [t]x (I + [w]x) for every sample of three smears, direction t and sign pattern.

    The order-free equation is |w . (p (t.p) - t (p.p))| = |t . (x x y)|; signs make it linear in w.

    Parameters
    ----------
    ends : ndarray of shape (B, 3, 2, 2)
        Samples of three smears in the coordinates of the assumed camera (K = identity).
    directions : ndarray of shape (T, 3)
        Unit directions of translation to try.
    limit : ndarray of shape (3,)
        Rotations w with |w / limit| > 1 are dropped.
    signs : ndarray of shape (B, P, 3), optional
        The sign patterns of every sample, as of `components.sample_patterns`; default all four.

    Returns
    -------
    ndarray of shape (M, 3, 3), M at most P B T
        Rank 2. Smears whose equations are dependent give no hypothesis.
    """
    x, y = homogeneous(ends[:, :, 0]), homogeneous(ends[:, :, 1])
    p = 0.5 * (x + y)  # (B, 3, 3)
    along = np.einsum("bic,tc->bti", p, directions)[..., None]  # t . p
    rows = along * p[:, None] - directions[:, None] * (p * p).sum(-1)[:, None, :, None]  # (B, T, 3, 3)
    right = np.einsum("bic,tc->bti", np.cross(x, y), directions)  # (B, T, 3)
    patterns = THREE_SIGNS if signs is None else signs[:, None]
    turn = _solve_three(rows, right[..., None, :] * patterns)  # (B, T, P, 3)
    _, direction, _ = kept = np.nonzero((turn / limit) ** 2 @ np.ones(3) <= 1)
    found: Array = cross_matrix(directions)[direction] @ (np.eye(3) + cross_matrix(turn[kept]))
    return found


def _solve_three(rows: Array, right: Array) -> Array:
    """Solve (..., 3, 3) systems for (..., P, 3) right sides by the adjugate; inf where singular."""
    r1, r2, r3 = np.moveaxis(rows, -2, 0)
    adjugate = np.stack([np.cross(r2, r3), np.cross(r3, r1), np.cross(r1, r2)], axis=-2)
    determinant = (r1 * adjugate[..., 0, :]).sum(-1)
    singular = np.abs(determinant) < TINY
    solved: Array = (right @ adjugate) / np.where(singular, 1.0, determinant)[..., None, None]
    solved[singular] = np.inf
    return solved


def meeting_points(ends: Array) -> Array:
    """Give the unit homogeneous points (B, 3) in which the lines of two smears, ends (B, 2, 2, 2), meet.

    Two parts of one line meet everywhere; the answer is then some point or zero.
    """
    lines = np.cross(homogeneous(ends[:, :, 0]), homogeneous(ends[:, :, 1]))  # (B, 2, 3)
    points = np.cross(lines[:, 0], lines[:, 1])
    unit: Array = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), TINY)
    return unit
