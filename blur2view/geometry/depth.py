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
from blur2view.geometry.rotation import rotation_flow

PROBIT_AS_LOGIT = 1.702  # log(Phi(z)) is -log(1 + exp(-1.702 z)) to within 0.01 in Phi
MOST_LOG_ODDS = 300.0  # against an order: two such make no number that is too small


def unit_lines(translations: Array, middle: Array) -> tuple[Array, Array]:
    """Return unit vectors (G, 2, N) along epipolar lines at points (N, 2) and across them, K = identity.

    Along is the way a point before the camera moves: to the epipole if t_z > 0, away from it if t_z < 0.
    """
    lines = translations[:, :2, None] - translations[:, 2, None, None] * middle.T
    along = lines / np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), TINY)
    return along, np.stack([-along[:, 1], along[:, 0]], axis=1)


def parallax_along_lines(rotation: Array, t: Array, middle: Array, displacement: Array) -> Array:
    """Return parallax (2, N) along the epipolar lines of every smear in both orders, K = identity.

    With ends[:, 0] first and with ends[:, 1] first; positive for points in front of the camera. Of midpoints
    and displacements ends[:, 1] - ends[:, 0], (N, 2). The rotation vector is taken to first order: cameras
    rotate by a few degrees at most. The sign of t (3,) decides which way is forward.
    """
    (along,), _ = unit_lines(t[None], middle)
    rotated = (along * np.tensordot(rotation, rotation_flow(middle), (0, 1))).sum(axis=0)
    moved = (along * displacement.T).sum(axis=0)
    return np.stack([moved - rotated, -moved - rotated])


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
