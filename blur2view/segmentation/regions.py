"""From scores of smears to moving parts: two thresholds.

Smears are read in windows of 96 pixels, so the smear of an object bleeds beyond it, and that of a small one
is lost in what surrounds it. Outlines are not fitted to the photograph: along its edges (a guided filter)
masks of true smears were worse on 20 rendered scenes with movers (IoU 0.47 against 0.49).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.segmentation.score import MotionScore
from blur2view.smears.field import upsample_grid
from blur2view.smears.matches import STRIDE

Mask = NDArray[np.bool_]
# Exceeded by chance in 5 % and 0.3 % (chi-square, one degree of freedom), before a still camera, whose smears
# err along both axes, in 15 % and 1.1 % (two).
LOW, HIGH = 3.84, 9.0
CORE = 2  # cells: a single one exceeds by chance
ODDS_SLOPE = 0.61  # of the log-odds of moving over the log score (76 rendered scenes); they are 0 at HIGH


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionCells:
    """Decisions on the grid (h, w) of the scores.

    Parameters
    ----------
    probability : ndarray of shape (h, w)
        That a cell moves: 0.5 where a part begins to be sure of it, 0 where nothing is observable.
    moving, observable : ndarray of bool, shape (h, w)
    """

    probability: Array
    moving: Mask
    observable: Mask


def decide(scored: MotionScore) -> MotionCells:
    """Decide by the scores of smears what moves.

    Parameters
    ----------
    scored : MotionScore
    """
    score = scored.score
    moving = moving_parts(score)
    agreed = scored.greatest <= HIGH  # what only some of the motions explain may be either
    seen = moving | ((scored.reach >= HIGH) & agreed)
    odds = (np.maximum(score, 1e-3) / HIGH) ** ODDS_SLOPE
    return MotionCells(probability=np.where(seen, odds / (1 + odds), 0.0), moving=moving, observable=seen)


def moving_parts(score: Array) -> Mask:
    """Mark the connected parts (h, w) that pass LOW everywhere and HIGH in CORE x CORE cells somewhere."""
    from scipy.ndimage import binary_opening, binary_propagation

    core = binary_opening(score > HIGH, np.ones((CORE, CORE)))
    return np.asarray(binary_propagation(core, mask=score > LOW))


def to_pixels(grid: Array | Mask, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Resample the network's grid (h, w) to pixels (H, W)."""
    large = upsample_grid(grid[..., None].astype(np.float32), STRIDE)[: shape[0], : shape[1], 0]
    missing = [(0, side - have) for side, have in zip(shape, large.shape, strict=True)]
    return np.pad(large, missing, mode="edge")
