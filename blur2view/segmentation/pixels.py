"""From places to pixels: outlines from the picture, connected parts, and their description."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray
from blur2view.movers.inputs import PLACE_PX

Mask = NDArray[np.bool_]
Floats = NDArray[np.float32]

LEAST_PIECES = 25
"""Places of the smallest piece that outlines leave of a part."""
GUIDE_PLACES, GUIDE_EPS = 2, 0.03
"""Radius of the windows in which outlines follow the picture, places; contrast of what is an edge, levels."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingRegion:
    """One connected part of a photograph that moves by itself.

    Parameters
    ----------
    area_px : int
        Its pixels.
    box : (int, int, int, int)
        Left, top, width and height, pixels.
    centroid : (float, float)
        (x, y), pixels.
    probability : float
        Mean probability of moving over it.
    """

    area_px: int
    box: tuple[int, int, int, int]
    centroid: tuple[float, float]
    probability: float


def to_pixels(places: Floats, image: AnyArray, place_px: int = PLACE_PX) -> Floats:
    """Resample values (h, w) of places in [0, 1] to the pixels of an image, along its edges.

    Places, squares of ``place_px`` pixels, cover the image.
    """
    height, width = image.shape[:2]
    rows, columns = -(-height // place_px), -(-width // place_px)
    size = columns * place_px, rows * place_px
    values = cv2.resize(places[:rows, :columns], size, interpolation=cv2.INTER_LINEAR)[:height, :width]
    grey = image if image.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    white = np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1
    grey = np.asarray(grey / np.float32(white), np.float32)
    along = cv2.ximgproc.guidedFilter(grey, values, GUIDE_PLACES, GUIDE_EPS, scale=1 / place_px)
    return np.asarray(np.clip(along, 0, 1), np.float32)


def moving_parts(part: Floats, image: AnyArray, threshold: float, place_px: int = PLACE_PX) -> Mask:
    """Mark the pixels (H, W) of the parts that move, whose outlines follow the picture's edges.

    Parameters
    ----------
    part : ndarray of shape (h, w)
        Probabilities of the parts that places, which cover the picture, belong to.
    image : ndarray of shape (H, W, 3) or (H, W)
    threshold : float
        Of these.
    place_px : int
        Side of a place, pixels.
    """
    likely = to_pixels((part >= threshold).astype(np.float32), image, place_px) > 0.5
    _, piece, stats, _ = cv2.connectedComponentsWithStats(likely.astype(np.uint8), connectivity=4)
    kept = stats[:, cv2.CC_STAT_AREA] >= LEAST_PIECES * place_px**2
    kept[0] = False
    return np.asarray(kept[piece])


def moving_regions(moving: Mask, probability: NDArray[np.float32]) -> tuple[MovingRegion, ...]:
    """Describe the connected parts of a mask (H, W), largest first."""
    count, part, stats, centres = cv2.connectedComponentsWithStats(moving.astype(np.uint8), connectivity=4)
    total = np.zeros(count)
    for row, values in zip(part, probability, strict=True):  # at once it would take 16 bytes per pixel
        total += np.bincount(row, weights=values, minlength=count)
    order = 1 + np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")
    return tuple(_region(stats[k], centres[k], total[k]) for k in order)


def _region(stats: NDArray[np.int32], centre: AnyArray, total: float) -> MovingRegion:
    """Describe a part by OpenCV's statistics, its centre and the sum of its probabilities."""
    left, top, width, height, area = (int(value) for value in stats)
    return MovingRegion(
        area_px=area,
        box=(left, top, width, height),
        centroid=(float(centre[0]), float(centre[1])),
        probability=float(total / area),
    )
