"""Epipolar lines of a translation, at midpoints of smears."""

from __future__ import annotations

import numpy as np

from blur2view.arrays import TINY, Array


def unit_lines(translations: Array, middle: Array) -> tuple[Array, Array]:
    """Return unit vectors (G, 2, N) along epipolar lines at points (N, 2) and across them, K = identity.

    Along is the way a point before the camera moves: to the epipole if t_z > 0, away from it if t_z < 0.
    """
    lines = translations[:, :2, None] - translations[:, 2, None, None] * middle.T
    along = lines / np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), TINY)
    return along, np.stack([-along[:, 1], along[:, 0]], axis=1)
