"""From evidence per cell to moving parts: two thresholds, superpixels, rules for small and faint parts.

A part moves where cells pass a low threshold and touch one that passes a high one. The network of moving
things has looked at the photograph, so its probabilities are taken as they are. Scores of smears are not:
the smear network's errors are correlated over tens of pixels, so a superpixel is evidence once, whatever
its size, and its score is the mean of its cells. That network smooths, too: before a still camera the
smear of an object bleeds beyond it, and the object's edge is found by its colours.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.segmentation.reduced import reduced_image
from blur2view.segmentation.score import MotionScore

Mask = NDArray[np.bool_]
# Exceeded by chance in 5 % and 0.3 % (chi-square, one degree of freedom), before a still camera, whose smears
# err along both axes, in 15 % and 1.1 % (two).
LOW, HIGH = 3.84, 9.0
CAP = 16.0  # of a cell's score: beyond four standard deviations more is no more evidence
WORK_SIDE = 320  # pixels along the longer side, at most
SUPERPIXELS, COMPACTNESS, SMOOTHING = 300, 0.2, 1.0
SURE_HEIGHT, FOOT_HEIGHT = 0.85, 0.3  # of an object's own height: surely of it, surely not
MARGIN = 12  # working pixels around a part within which it may grow
CUTS, FEWEST, NO_BOX = 3, 20, (0, 0, 1, 1)
EDGE = 1e-4  # variance of grey levels from which the guided filter keeps an edge
LEAST_OVERLAP, LEAST_KEPT = 0.4, 0.1  # of the cut in the part, of the part in the cut
WHOLE_PIXELS = 4_000_000  # that are filtered at a time, in 50 bytes each
LEAST_SHARE = 0.003  # of the photograph that a moving part covers, and a hole in one
# Of the network's probability; the best overlap on 52 rendered development scenes, 24 of them with movers,
# where 1.5 % of the others may be called moving. Below the last one a part that scores found is denied.
LOW_PROBABILITY, HIGH_PROBABILITY, DENIED = 0.7, 0.9, 0.1
ODDS_SLOPE = 0.61  # of the log-odds of moving over the log score (76 rendered scenes); they are 0 at HIGH


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionCells:
    """Decisions on a working grid (h, w) over the photograph.

    Parameters
    ----------
    probability : ndarray of shape (h, w)
        That a cell moves: 0.5 where a part begins to be sure of it, 0 where nothing is observable.
    moving, observable : ndarray of bool, shape (h, w)
    """

    probability: Array
    moving: Mask
    observable: Mask

    @classmethod
    def of(cls, odds: Array, moving: Mask, seen: Mask) -> MotionCells:
        """Make them of the odds (h, w) that cells move; what is seen to move can be seen."""
        observable = seen | moving
        return cls(
            probability=np.where(observable, odds / (1 + odds), 0.0), moving=moving, observable=observable
        )


def decide(scored: MotionScore, image: NDArray[np.float32] | None, shape: tuple[int, int]) -> MotionCells:
    """Decide by the scores of smears what moves.

    Parameters
    ----------
    scored : MotionScore
        On the network's grid.
    image : ndarray of shape (H, W, 3), float32, or None
        The photograph; without it squares stand for superpixels.
    shape : (int, int)
        H and W.
    """
    small = reduced_image(np.zeros((*shape, 3), np.float32) if image is None else image, WORK_SIDE)
    shape = small.shape[:2]
    score, reach = (resized(field, shape) for field in (scored.score, scored.reach))
    part = superpixels(small)
    sure = (reach >= HIGH).astype(float)
    pooled = part_mean(np.minimum(score, CAP), sure + 1e-6, part)
    seen = part_mean(sure, np.ones(shape), part) >= 0.5
    moving = moving_parts(np.where(seen, pooled, 0.0), LOW, HIGH)
    if scored.still and image is not None:
        moving = along_colours(moving, score, small)
    odds = (np.maximum(pooled, 1e-3) / HIGH) ** ODDS_SLOPE
    return MotionCells.of(odds, moving, seen)


def decide_by_network(
    scored: MotionScore, image: NDArray[np.float32], probability: NDArray[np.float32]
) -> MotionCells:
    """Decide by the motion segmentation network what moves, and by scores where it does not deny it.

    Parameters
    ----------
    scored : MotionScore
        On the smear network's grid.
    image : ndarray of shape (H, W, 3), float32
        The photograph.
    probability : ndarray of shape (H, W), float32
        That pixels move, as the network says.
    """
    from scipy.ndimage import label, mean

    alone = decide(scored, image, probability.shape)
    chance = resized(probability.astype(float), alone.moving.shape)
    part, count = label(alone.moving)
    kept = np.r_[0.0, mean(chance, part, np.arange(1, count + 1))] >= DENIED
    moving = moving_parts(chance, LOW_PROBABILITY, HIGH_PROBABILITY) | kept[part]
    odds = chance / np.maximum(1 - chance, 1e-6) * ((1 - HIGH_PROBABILITY) / HIGH_PROBABILITY)
    return MotionCells.of(odds, moving, alone.observable)


def resized(field: Array, shape: tuple[int, ...]) -> Array:
    """Resample a field (h, w) to a working grid."""
    way = cv2.INTER_AREA if field.shape[0] > shape[0] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(field, (shape[1], shape[0]), interpolation=way), float).reshape(shape)


def superpixels(image: NDArray[np.float32]) -> NDArray[np.int_]:
    """Assign the pixels of a small photograph (h, w, 3) to numbered superpixels, (h, w)."""
    from skimage.segmentation import slic  # 0.4 s, so only where masks are asked for

    part = slic(
        cv2.cvtColor(image, cv2.COLOR_RGB2Lab),
        n_segments=SUPERPIXELS,
        compactness=COMPACTNESS,
        sigma=SMOOTHING,
        max_num_iter=5,
        convert2lab=False,
        channel_axis=-1,
        start_label=0,
    )
    return np.asarray(part, np.int_)


def part_mean(values: Array, weight: Array, part: NDArray[np.int_]) -> Array:
    """Replace values (h, w) by their weighted mean over each numbered part."""
    total = np.bincount(part.ravel(), weights=(values * weight).ravel())
    mean = total / np.maximum(np.bincount(part.ravel(), weights=weight.ravel()), 1e-12)
    return np.asarray(mean[part])


def moving_parts(score: Array, low: float, high: float) -> Mask:
    """Mark the connected parts (h, w) that pass low everywhere and high somewhere, without small ones."""
    from skimage.filters import apply_hysteresis_threshold

    moving = np.asarray(apply_hysteresis_threshold(score, low, high))
    return without_small(~without_small(~without_small(moving)))


def along_colours(moving: Mask, score: Array, image: NDArray[np.float32]) -> Mask:
    """Fit the parts of a mask (h, w) to the colours of a small photograph (h, w, 3), one by one.

    A graph cut between what is surely of the object (its highest scores) and what surely is not; a part
    whose colours lead elsewhere stays as it was.

    References
    ----------
    Rother, Kolmogorov and Blake, GrabCut, SIGGRAPH 2004.
    """
    from scipy.ndimage import label  # 0.15 s, so only where masks are asked for

    height, (part, count) = np.sqrt(score), label(moving)
    fitted = np.zeros_like(moving)
    for k in range(1, count + 1):
        fitted |= _fitted(part == k, height, np.round(255 * image).astype(np.uint8))
    return fitted


def _fitted(region: Mask, height: Array, image: NDArray[np.uint8]) -> Mask:
    """Fit one part to its colours."""
    top = float(np.quantile(height[region], 0.95))
    around = cv2.dilate(region.astype(np.uint8), np.ones((2 * MARGIN + 1,) * 2, np.uint8)) > 0
    rows, columns = (np.flatnonzero(around.any(axis=axis)) for axis in (1, 0))
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    sure = (region & (height >= SURE_HEIGHT * top))[window]
    never = ~around[window] | (height[window] < FOOT_HEIGHT * top)
    if sure.sum() < FEWEST or never.sum() < FEWEST:
        return region
    marks = np.where(sure, cv2.GC_FGD, np.where(never, cv2.GC_BGD, cv2.GC_PR_BGD)).astype(np.uint8)
    cv2.setRNGSeed(0)  # of the colour clusters' starts
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(image[window], marks, NO_BOX, *models, CUTS, cv2.GC_INIT_WITH_MASK)
    cut = np.zeros_like(region)
    cut[window] = (marks == cv2.GC_FGD) | (marks == cv2.GC_PR_FGD)
    cut = without_small(~without_small(~cut))
    similar = (cut & region).sum() >= LEAST_OVERLAP * max(
        cut.sum(), 1
    ) and cut.sum() >= LEAST_KEPT * region.sum()
    return cut if similar else region


def without_small(mask: Mask) -> Mask:
    """Clear connected parts of a mask (h, w) that cover less than LEAST_SHARE of it."""
    from scipy.ndimage import label

    part, _ = label(mask)
    count = np.bincount(part.ravel())
    large = count >= LEAST_SHARE * mask.size
    large[0] = False
    return np.asarray(large[part])


def to_pixels(cells: Array, image: NDArray[np.float32] | None, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Carry working pixels (h, w) in [0, 1] to all pixels (H, W) along the edges of a photograph (H, W, 3).

    References
    ----------
    He, Sun and Tang, Guided image filtering, PAMI 2013.
    """
    large = np.asarray(cv2.resize(cells.astype(np.float32), shape[::-1], interpolation=cv2.INTER_LINEAR))
    if image is None:
        return large
    radius = max(round(2 * max(shape) / max(cells.shape)), 2)
    carried = np.empty_like(large)
    strip = shape[0] if large.size <= WHOLE_PIXELS else max(WHOLE_PIXELS // shape[1], 1)
    for first in range(0, shape[0], strip):
        # a pixel depends on what lies within twice the radius
        above, last = max(first - 2 * radius, 0), min(first + strip, shape[0])
        rows = slice(above, last + 2 * radius)
        guide = cv2.cvtColor(image[rows], cv2.COLOR_RGB2GRAY)
        filtered = cv2.ximgproc.guidedFilter(guide, large[rows], radius, EDGE)
        carried[first:last] = filtered.reshape(guide.shape)[first - above : last - above]
    return np.clip(carried, 0, 1, out=carried)
