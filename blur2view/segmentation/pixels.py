"""From half cells to pixels: outlines from the picture, connected parts, and their description."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Array
from blur2view.smears.field import upsample_grid

Mask = NDArray[np.bool_]
# Probabilities: of every pixel of a part that moves; below the second it stands still.
LEAST_MOVING, MOST_STILL = 0.3, 0.12
LEAST_AREA_PX = 1600  # of a part: a window of the network reads 96 x 96 pixels
REDUCED = 4  # pixels to one in which outlines are followed
GUIDE_RADIUS, GUIDE_EPS = 6, 1e-3  # reduced pixels; squared levels


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


def to_pixels(places: NDArray[np.float32], size_px: int, image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Resample values in [0, 1] of places (h, w) to the pixels of an image (H, W, 3), along its edges.

    A place has ``size_px`` pixels a side; together they cover the image.

    References
    ----------
    He, Sun and Tang, Guided image filtering, PAMI 2013.
    """
    height, width = image.shape[:2]
    zoom = max(size_px // REDUCED, 1)
    coarse = upsample_grid(places[..., None], zoom)[..., 0]
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    missing = [(0, n * size_px - side) for n, side in zip(places.shape, grey.shape, strict=True)]
    padded = np.pad(grey, missing, mode="symmetric")
    small = cv2.resize(padded, coarse.shape[::-1], interpolation=cv2.INTER_AREA)
    guided = np.asarray(cv2.ximgproc.guidedFilter(small, coarse, GUIDE_RADIUS, GUIDE_EPS), np.float32)
    pixels = upsample_grid(guided[..., None], size_px // zoom)[:height, :width, 0]
    return np.clip(pixels, 0, 1)


def moving_parts(probability: NDArray[np.float32], least: float, share: float) -> Mask:
    """Mark the connected parts (H, W) that may move everywhere and are large enough.

    More than a ``share`` of each, 0 to 1, has a probability of at least ``least``.
    """
    likely = probability >= LEAST_MOVING
    _, part, stats, _ = cv2.connectedComponentsWithStats(likely.astype(np.uint8), connectivity=4)
    area = stats[:, cv2.CC_STAT_AREA]
    moves = np.bincount(part[probability >= least], minlength=len(stats)) > share * area
    moves &= area >= LEAST_AREA_PX
    moves[0] = False
    return np.asarray(moves[part])


def parts_above(moving: Mask, values: Array, least: float, stride: int) -> Mask:
    """Keep the connected parts of a mask (H, W) over which values of cells (h, w) have so high a mean."""
    count, part = cv2.connectedComponents(moving.astype(np.uint8), connectivity=4)
    rows, columns = (np.arange(side) // stride for side in moving.shape)
    size, total = np.zeros(count), np.zeros(count)
    for row, line in zip(part, rows, strict=True):
        size += np.bincount(row, minlength=count)
        total += np.bincount(row, weights=values[line, columns], minlength=count)
    above = total >= least * size
    above[0] = False
    return np.asarray(above[part])


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
