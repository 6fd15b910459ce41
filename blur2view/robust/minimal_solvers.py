"""Starts of F: coarse ones from three smears whose ends have no order, or from two.

A photograph's camera is roughly known (`calibration.ASSUMED_FOCAL`) and rotates little during an exposure:
F = [t]x (I + [w]x) to first order, and for every direction t of a grid three smears fix w linearly. These
starts are approximate; local optimisation makes them exact. (Seven smears fix any F exactly, but one wrong
smear in seven spoils them, and noise does too: `tools.estimators.seven_smears`.)
"""

from __future__ import annotations

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import cross_matrix, homogeneous

THREE_SIGNS: Array = np.array([[1.0, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]])


def small_rotation_hypotheses(ends: Array, directions: Array, limit: Array) -> Array:
    """Return F = [t]x (I + [w]x), (M, 3, 3), for every sample of three smears, direction t and four patterns.

    The order-free equation is |w . (p (t.p) - t (p.p))| = |t . (x x y)|; signs make it linear in w. Samples
    (B, 3, 2, 2) are in coordinates of the assumed camera (K = identity), directions (T, 3) of unit length.
    Rotations w with |w / limit| > 1, ``limit`` (3,), are dropped, as are dependent smears.
    """
    x, y = (np.moveaxis(homogeneous(ends[:, :, i]), -1, 0)[..., None] for i in (0, 1))  # (3, B, 3, 1)
    p, t = 0.5 * (x + y), directions.T[:, None]  # and (3, 1, T)
    smears = p * (p * t[:, None]).sum(axis=0) - t[:, None] * (p * p).sum(axis=0)  # rows (3, B, 3, T)
    right = (_cross(x, y) * t[:, None]).sum(axis=0)  # (B, 3, T)
    first, second, third = np.moveaxis(smears, 2, 0)  # each (3, B, T)
    adjugate = np.stack([_cross(second, third), _cross(third, first), _cross(first, second)], axis=1)
    determinant = (first * adjugate[:, 0]).sum(axis=0)  # (B, T)
    regular = np.abs(determinant) >= TINY
    shares = adjugate * (np.moveaxis(right, 1, 0) / np.where(regular, determinant, np.nan))  # (3, 3, B, T)
    rotation = THREE_SIGNS @ np.moveaxis(shares, 2, 0).swapaxes(1, 2).reshape(len(ends), 3, -1)  # (B, 4, 3 T)
    rotation = rotation.reshape(len(ends), -1, 3, len(directions))
    inside = (rotation**2 * (limit**-2.0)[:, None]).sum(axis=2) <= 1  # False where singular
    sample, pattern, direction = np.nonzero(inside)
    w, along = rotation[sample, pattern, :, direction], directions[direction]
    hypotheses: Array = w[:, :, None] * along[:, None, :]  # [t]x [w]x = w t^T - (t . w) I
    hypotheses += cross_matrix(directions)[direction]
    hypotheses.reshape(-1, 9)[:, ::4] -= (w * along).sum(axis=1)[:, None]
    return hypotheses


def _cross(a: Array, b: Array) -> Array:
    """Return cross products along the first axis."""
    x = a[1] * b[2] - a[2] * b[1]
    return np.stack([x, a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def meeting_points(ends: Array) -> Array:
    """Return the unit homogeneous points (B, 3) where the lines of two smears (B, 2, 2, 2) meet.

    Two parts of one line meet everywhere; the answer is then some point or zero.
    """
    lines = np.cross(homogeneous(ends[:, :, 0]), homogeneous(ends[:, :, 1]))  # (B, 2, 3)
    points = np.cross(lines[:, 0], lines[:, 1])
    unit: Array = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), TINY)
    return unit
