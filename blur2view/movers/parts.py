"""Which connected parts of a photograph move by themselves: one decision for each of them.

A network's probabilities of neighbouring places are alike, and so are its errors: a part is judged as a
whole, by its highest log-odds. How far it reaches is relative to them, as the network is surer of one
photograph than of another: to halfway down to the median of the picture. So no more than half of it moves.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array

Floats = NDArray[np.float32]

THRESHOLD = 0.5
"""Probability from which on a part moves."""
REACH = 0.5
"""Height of a part's edge between the median and the highest log-odds of the picture; 0.45 to 0.6 do, too."""
CONSTANT, PEAK = 0.29, 0.36
"""Log-odds that a part moves: a constant, and a share of its highest log-odds."""


def parts_of(odds: Floats, known: NDArray[np.bool_]) -> Floats:
    """Return the probability (h, w) that the part a place belongs to moves; 0 where there is none.

    Parameters
    ----------
    odds : ndarray of shape (h, w)
        Log-odds that places move.
    known : ndarray of shape (h, w), bool
        Places that the picture shows something about.
    """
    part, highest = described(odds, known)
    probability = 1 / (1 + np.exp(-CONSTANT - PEAK * highest))
    return np.asarray(np.concatenate([[0.0], probability])[part], np.float32)


def described(odds: Floats, known: NDArray[np.bool_]) -> tuple[NDArray[np.int32], Array]:
    """Return the parts, (h, w) numbered from 1, and the highest log-odds (N,) of each."""
    if not known.any():
        return np.zeros(odds.shape, np.int32), np.zeros(0)
    low, high = np.median(odds[known]), odds[known].max()
    likely = known & (odds > low + REACH * (high - low))
    count, part = cv2.connectedComponents(likely.astype(np.uint8), connectivity=4)
    highest = np.full(count, -np.inf)
    np.maximum.at(highest, part.ravel(), odds.ravel())
    return part, highest[1:]
