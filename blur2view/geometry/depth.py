"""The order of a smear by positive depth (cheirality).

A point in front of the camera moves, once the rotation is taken off, away from the epipole of a camera that
goes forward and towards that of one that goes back. So a motion (rotation and translation of an
approximately known camera) decides of every smear which of its two orders a point in front of the camera can
have: where the translation moves points further along their epipolar lines than the rotation does, exactly
one. It is the cheirality of two views, read before any order is known.
"""

from __future__ import annotations

import numpy as np

from blur2view.arrays import TINY, Array

PROBIT_AS_LOGIT = 1.702  # log(Phi(z)) is -log(1 + exp(-1.702 z)) to within 0.01 in Phi
MOST_LOG_ODDS = 300.0  # against an order: two such make no number that is too small


def parallax_along_lines(rotation: Array, t: Array, middle: Array, displacement: Array) -> Array:
    """Return parallax (2, N) along the epipolar lines, away from the epipole, of every smear in both orders.

    With ends[:, 0] first and with ends[:, 1] first; positive for points in front of the camera. Midpoints and
    displacements ends[:, 1] - ends[:, 0], (2, N), are in coordinates of a camera with K = identity. The
    rotation vector is taken to first order: cameras rotate by a few degrees at most. The sign of t (3,)
    decides which way is forward.
    """
    x, y = middle
    spin = rotation[0] * y - rotation[1] * x
    rotation_x, rotation_y = (
        rotation[1] - rotation[2] * y - spin * x,
        rotation[2] * x - rotation[0] - spin * y,
    )
    line_x, line_y = t[0] - t[2] * x, t[1] - t[2] * y
    length = np.maximum(np.sqrt(line_x * line_x + line_y * line_y), TINY)
    moved = (displacement[0] * line_x + displacement[1] * line_y) / length
    rotated = (rotation_x * line_x + rotation_y * line_y) / length
    both = np.empty((2, len(moved)))
    np.subtract(moved, rotated, out=both[0])
    np.subtract(-moved, rotated, out=both[1])
    return both


def order_log_odds(parallax: Array, sigma: Array) -> Array:
    """Return the log-probabilities (2, N) of both orders by their parallax (2, N), known to a sigma (N,).

    An order is as probable as its parallax is positive. Where both are feasible they share, so that a motion
    gains nothing by being vague; where none is, both are improbable.
    """
    against = parallax * (-PROBIT_AS_LOGIT / sigma)
    feasible = 1 / (1 + np.exp(np.minimum(against, MOST_LOG_ODDS)))
    shared = np.maximum(*feasible) / np.add(*feasible)
    log_odds: Array = np.log(feasible * shared)
    return log_odds
