"""Poses of a known camera from a grid of translations: for each, the rotation that explains most smears.

A fit that starts elsewhere may end where another rotation and a translation 5 to 10 degrees off leave
residuals of a hundredth of a smear's length: of 30 exact synthetic scenes three did. Given the translation, a
smear moves away from the epipole, or to it if t_z > 0, for its point lies before the camera; so its order is
known, the rotation follows linearly, and a coarse grid of translations has no false minimum to be caught in.
"""

from __future__ import annotations

import numpy as np

from blur2view.epipolar import TINY, Array
from blur2view.hypotheses import half_sphere
from blur2view.seven_smears import plane_basis

DIRECTIONS = 80  # half a sphere in steps of about 9 degrees; basins of exact scenes reach as far
SMEARS = 250  # of which the rotations are found, if there are more: every n-th, so up to twice as many
RINGS_DEG = (5.0, 2.5, 1.2, 0.6)  # about the best of the grid, and then of each ring
RING: Array = np.array([[np.cos(angle), np.sin(angle)] for angle in np.arange(6) * np.pi / 3])
STEPS = 3  # of reweighting
LEAST = 1e-3  # share of its length to which a smear is believed at best


def turn_flow(middle: Array) -> Array:
    """Motion (2, 3, N) of points per radian of rotation about x, y and z, to first order.

    Parameters
    ----------
    middle : ndarray of shape (N, 2)
        Coordinates of a camera with K = identity.

    Returns
    -------
    ndarray of shape (2, 3, N)
        A rotation w moves the point p by w x p - p (w x p)_z.
    """
    x, y = middle.T
    return np.array([[-x * y, 1 + x * x, -y], [-(1 + y * y), x * y, x]])


def translation_search(ends: Array) -> tuple[Array, Array]:
    """Give the pose under which smears miss their lines least: of a grid, then of ever smaller rings.

    Parameters
    ----------
    ends : ndarray of shape (N, 2, 2)
        Smears, ends in any order, in coordinates of a camera with K = identity.

    Returns
    -------
    turn, t : ndarray of shape (3,)
        Rotation vector, to first order, and unit translation; both reversed is the other flip of time.
    """
    ends = ends[:: max(1, len(ends) // SMEARS)]
    turn, t = _best(half_sphere(DIRECTIONS), ends)
    for radius in np.tan(np.radians(RINGS_DEG)):
        ring = t + radius * RING @ plane_basis(t)
        turn, t = _best(np.vstack([t, ring / np.linalg.norm(ring, axis=1, keepdims=True)]), ends)
    return turn, t


def _best(translations: Array, ends: Array) -> tuple[Array, Array]:
    """Rotation vector and translation that smears miss least."""
    turns, misses = turns_given(translations, ends)
    best = int(np.argmin(misses))
    return turns[best], translations[best]


def turns_given(translations: Array, ends: Array) -> tuple[Array, Array]:
    """Find the rotation that goes with each of G translations, by iteratively reweighted least squares.

    Parameters
    ----------
    translations : ndarray of shape (G, 3)
    ends : ndarray of shape (N, 2, 2)
        As of `translation_search`.

    Returns
    -------
    turns : ndarray of shape (G, 3)
        Rotation vectors.
    misses : ndarray of shape (G,)
        Mean logarithm of the squared distance of the smears' ends from their lines, over their lengths: the
        profile likelihood of errors of unknown size, robust.
    """
    middle, displacement = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    length = np.maximum(np.hypot(*displacement.T), TINY)
    along, across = unit_lines(translations, middle)  # (G, 2, N)
    flow = turn_flow(middle) / length
    rows = across[:, 0, None] * flow[0] + across[:, 1, None] * flow[1]  # (G, 3, N)
    unit = displacement.T / length
    outwards = np.where((along * unit).sum(axis=1) >= 0, 1.0, -1.0)
    wanted = outwards * (across * unit).sum(axis=1)  # (G, N)
    weight = np.ones_like(wanted)
    for _ in range(STEPS):
        weighted = rows * weight[:, None]
        normal = weighted @ rows.transpose(0, 2, 1)
        normal += np.eye(3) * (1e-9 * np.trace(normal, axis1=1, axis2=2) + TINY)[:, None, None]
        turns = np.linalg.solve(normal, weighted @ wanted[:, :, None])[:, :, 0]
        missed = (turns[:, None] @ rows)[:, 0] - wanted
        spread = 1.4826 * np.median(np.abs(missed), axis=1, keepdims=True) + TINY
        weight = 1 / (1 + (missed / spread) ** 2)
    return turns, np.log(missed**2 + LEAST**2).mean(axis=1)


def unit_lines(translations: Array, middle: Array) -> tuple[Array, Array]:
    """Give unit vectors (G, 2, N) along epipolar lines and across them.

    Along is the way a point before the camera moves: to the epipole if t_z > 0, away from it if t_z < 0.
    """
    lines = translations[:, :2, None] - translations[:, 2, None, None] * middle.T
    along = lines / np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), TINY)
    return along, np.stack([-along[:, 1], along[:, 0]], axis=1)
