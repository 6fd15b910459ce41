"""Poses of a known camera from a grid of translations: for each, the rotation that explains most smears.

A fit that starts elsewhere may end where another rotation and a translation 5 to 10 degrees off leave
residuals of a hundredth of a smear's length: of 30 exact synthetic scenes three did. Given the translation, a
smear moves away from the epipole, or to it if t_z > 0, for its point lies before the camera; so its order is
known, the rotation follows linearly, and a coarse grid of translations has no false minimum to be caught in.
"""

from __future__ import annotations

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.rotation import half_sphere, plane_basis, rotation_flow
from blur2view.robust.reweighted import reweighted_motion

DIRECTIONS = 80  # half a sphere in steps of about 9 degrees; basins of exact scenes reach as far
SMEARS = 250  # of which the rotations are found, if there are more: every n-th, so up to twice as many
RINGS_DEG = (5.0, 2.5, 1.2, 0.6)  # about the best of the grid, and then of each ring
RING: Array = np.array([[np.cos(angle), np.sin(angle)] for angle in np.arange(6) * np.pi / 3])
STEPS = 3  # of reweighting
LEAST = 1e-3  # share of its length to which a smear is believed at best


def translation_search(ends: Array) -> tuple[Array, Array]:
    """Return the pose under which smears miss their lines least: of a grid, then of ever smaller rings.

    Parameters
    ----------
    ends : ndarray of shape (N, 2, 2)
        Smears, ends in any order, in coordinates of a camera with K = identity.

    Returns
    -------
    rotation, t : ndarray of shape (3,)
        Rotation vector, to first order, and unit translation; both reversed is the other flip of time.
    """
    ends = ends[:: max(1, len(ends) // SMEARS)]
    rotation, t = _best(half_sphere(DIRECTIONS), ends)
    for radius in np.tan(np.radians(RINGS_DEG)):
        ring = t + radius * RING @ plane_basis(t)
        rotation, t = _best(np.vstack([t, ring / np.linalg.norm(ring, axis=1, keepdims=True)]), ends)
    return rotation, t


def _best(translations: Array, ends: Array) -> tuple[Array, Array]:
    """Return the rotation vector and translation that smears miss least."""
    rotations, misses = rotations_given(translations, ends)
    best = int(np.argmin(misses))
    return rotations[best], translations[best]


def rotations_given(translations: Array, ends: Array) -> tuple[Array, Array]:
    """Return the rotation that goes with each of G translations, by iteratively reweighted least squares.

    Parameters
    ----------
    translations : ndarray of shape (G, 3)
    ends : ndarray of shape (N, 2, 2)
        As of `translation_search`.

    Returns
    -------
    rotations : ndarray of shape (G, 3)
        Rotation vectors.
    misses : ndarray of shape (G,)
        Mean logarithm of the squared distance of the smears' ends from their lines, over their lengths: the
        profile likelihood of errors of unknown size, robust.
    """
    middle, displacement = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    length = np.maximum(np.hypot(*displacement.T), TINY)
    along, across = unit_lines(translations, middle)  # (G, 2, N)
    flow = rotation_flow(middle) / length
    rows = across[:, 0, None] * flow[0] + across[:, 1, None] * flow[1]  # (G, 3, N)
    unit = displacement.T / length
    outwards = np.where((along * unit).sum(axis=1) >= 0, 1.0, -1.0)
    wanted = outwards * (across * unit).sum(axis=1)  # (G, N)
    rotations, missed = reweighted_motion(rows[:, :, None], wanted[:, None], steps=STEPS, scale=_deviation)
    return rotations, np.log(missed**2 + LEAST**2).mean(axis=1)


def _deviation(missed: Array) -> Array:
    """Return the robust standard deviation (G, 1) of residuals (G, N)."""
    return np.asarray(1.4826 * np.median(missed, axis=1, keepdims=True) + 1e-9)


def unit_lines(translations: Array, middle: Array) -> tuple[Array, Array]:
    """Return unit vectors (G, 2, N) along epipolar lines and across them.

    Along is the way a point before the camera moves: to the epipole if t_z > 0, away from it if t_z < 0.
    """
    lines = translations[:, :2, None] - translations[:, 2, None, None] * middle.T
    along = lines / np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), TINY)
    return along, np.stack([-along[:, 1], along[:, 0]], axis=1)
