"""A photograph's octaves: each half the size of the one before, joined on one axis of lengths."""

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.smears.likelihood import PER_OCTAVE

Floats = NDArray[np.float32]

LEVELS = 4
"""Sizes at most, the photograph's own included: a copy of half the size brings smears of twice the length
within the network's reach of 2 to 38 px."""
SMALLEST_PX = 90
"""Copies with a side below this are not made: a window of the network has 96 px."""


def octave_count(shape: tuple[int, ...], levels: int = LEVELS) -> int:
    """Return how many sizes of an image (H, W, ...) are read."""
    return min(levels, 1 + int(np.log2(max(min(shape[:2]) / SMALLEST_PX, 1))))


def octaves(grey: Floats, count: int) -> list[Floats]:
    """Return a picture (H, W) and its smaller copies, 2 x 2 pixels averaged, the smallest last."""
    levels = [grey]
    for _ in range(count - 1):
        height, width = levels[-1].shape
        half = cv2.resize(levels[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(half, np.float32))
    return levels


def doubled(cells: Floats, shape: tuple[int, int]) -> Floats:
    """Return cells (h, w, ...) of a smaller copy on the grid, of this shape, of the next larger one.

    The same where that has no more cells.
    """
    if cells.shape[:2] == shape:
        return cells
    h, w = cells.shape[:2]
    larger = np.empty((h, 2, w, 2, *cells.shape[2:]), cells.dtype)
    larger[:] = cells[:, None, :, None]
    return larger.reshape(2 * h, 2 * w, *cells.shape[2:])[: shape[0], : shape[1]]


def joined(fine: Floats, coarse: Floats) -> Floats:
    """Return one octave's logits (h, w, ..., B) plus those of all smaller ones (h, w, ..., C), on one axis.

    A length, or a radius, of the smaller copy is twice as long here, one octave up the axis; what is shorter
    or longer than an octave can read has one logit for all such lengths.
    """
    bins = coarse.shape[-1] + PER_OCTAVE
    own = np.minimum(np.arange(bins), fine.shape[-1] - 1)
    smaller = np.maximum(np.arange(bins) - PER_OCTAVE, 0)
    joint: Floats = fine[..., own] + coarse[..., smaller]
    return joint
