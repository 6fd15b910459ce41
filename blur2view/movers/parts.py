"""Which connected parts of a photograph move by themselves: one decision for each of them.

A network's probabilities of neighbouring places are alike, and so are its errors: a part is judged as a
whole, by its highest probability and by how far its smears depart from the camera's motion, in deviations.
What is smooth may look as if it moved, and departs by little.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array

Floats = NDArray[np.float32]

THRESHOLD = 0.5
"""Probability from which on a part moves."""
LEAST = 0.3
"""Probability of every place of a part."""
LEAST_PLACES = 100
"""Smallest part: a window of the smear network shows 24 x 24 places."""
MOST = 0.45
"""Share of the picture from which on a part may as well be the surroundings that a camera passes: it does not
count as one that moves: with 0.6 more of what moves is found, and far more of what only lies deep."""
CONSTANT, PEAK, DEPARTURE = -0.78, 1.56, 1.0
"""Log-odds that a part moves: a constant, a share of the log-odds of its highest probability, and a power of
its mean departure; fitted as by ``python -m tools.training.fit_parts``, and the constant raised by 0.4, at
which no part of RedKitchen's and Kodak's photographs moves: see the training log, sixteenth."""
FLOOR = 0.05
"""Least departure, deviations."""
HIGHEST = 0.99
"""Probability from which on higher ones say no more."""


def parts_of(moving: Floats, departure: Array) -> Floats:
    """Return the probability (h, w) that the part a place belongs to moves; 0 where there is none.

    Parameters
    ----------
    moving : ndarray of shape (h, w)
        Probabilities of places.
    departure : ndarray of shape (h, w)
        How far their smears depart from the camera's motion, standard deviations.
    """
    part, features = described(moving, departure)
    odds = CONSTANT + features @ np.array([PEAK, DEPARTURE])
    probability = 1 / (1 + np.exp(-odds))
    return np.asarray(np.concatenate([[0.0], probability])[part], np.float32)


def described(moving: Floats, departure: Array) -> tuple[NDArray[np.int32], Array]:
    """Return the parts, (h, w) numbered from 1, and of each the two features (N, 2) it is judged by."""
    likely = (moving >= LEAST).astype(np.uint8)
    _, part, stats, _ = cv2.connectedComponentsWithStats(likely, connectivity=4)
    large = (stats[:, cv2.CC_STAT_AREA] >= LEAST_PLACES) & (stats[:, cv2.CC_STAT_AREA] <= MOST * moving.size)
    large[0] = False
    part = np.where(large, np.cumsum(large), 0).astype(np.int32)[part]
    area = stats[large, cv2.CC_STAT_AREA]
    mean = np.bincount(part.ravel(), departure.ravel(), large.sum() + 1)[1:] / area
    peak = np.zeros(len(area) + 1)
    np.maximum.at(peak, part.ravel(), moving.ravel())
    highest = np.minimum(peak[1:], HIGHEST)
    return part, np.stack([np.log(highest / (1 - highest)), np.log(mean + FLOOR)], axis=1)
