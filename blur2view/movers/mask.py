"""Motion masks: which pixels move by themselves, given the camera's own motion."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray
from blur2view.images.pixels import photograph_of, white_of
from blur2view.movers.moving import THRESHOLD, Moving, moving_in
from blur2view.networks.model_file import Execution
from blur2view.networks.threads import one_thread
from blur2view.smears.grid import SmearGrid

Mask = NDArray[np.bool_]
Floats = NDArray[np.float32]

LEAST_PLACES = 25
"""Places of the smallest piece that outlines leave of a part."""
GUIDE_PLACES, GUIDE_EPS = 2, 0.03
"""Radius of the windows in which outlines follow the picture, places; contrast of what is an edge, levels."""


class MotionLabel(IntEnum):
    """What a pixel of a motion mask shows."""

    STATIC = 0
    MOVING = 1
    UNOBSERVABLE = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingRegion:
    """One connected part of a photograph that moves by itself."""

    area_px: int
    """Its pixels."""
    box: tuple[int, int, int, int]
    """Left, top, width and height, pixels."""
    centroid: tuple[float, float]
    """(x, y), pixels."""
    probability: float
    """Mean probability of moving over it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionMask:
    """Which pixels move by themselves."""

    labels: NDArray[np.uint8]
    """(H, W) of `MotionLabel`: 0 static, 1 moving, 2 unobservable."""
    probability: Floats
    """(H, W): that a pixel moves, in [0, 1]."""
    regions: tuple[MovingRegion, ...]
    """The connected moving parts, largest first."""
    reason: str
    """What motion was measured against."""

    @property
    def shares(self) -> dict[str, float]:
        """Shares of the pixels that are static, moving and unobservable."""
        return {label.name.lower(): float((self.labels == label).mean()) for label in MotionLabel}


class EstimateLike(Protocol):
    """What is asked of a `blur2view.Estimate`."""

    @property
    def grid(self) -> SmearGrid:
        """Return the smears."""

    @property
    def moving(self) -> Moving | None:
        """Return what moves by itself, if that was asked."""

    @property
    def execution(self) -> Execution:
        """Return what runs the networks."""


@one_thread
def segment(
    estimate: EstimateLike,
    image: AnyArray,
    rng: np.random.Generator | None = None,
    *,
    threshold: float = THRESHOLD,
) -> MotionMask:
    """Return which pixels move by themselves and which the camera's motion explains.

    Unobservable is what the picture shows nothing of: it is smooth.

    Parameters
    ----------
    estimate : Estimate
        Of one photograph.
    image : ndarray of shape (H, W, 3) or (H, W)
        The photograph, as it was estimated.
    rng : numpy.random.Generator, optional
        Draws starts of the fit of the camera's motion; ``default_rng(0)`` by default.
    threshold : float
        Probability that the highest place of a part must reach, above 0 and below 1. A lower one misses less
        of what moves, and marks more of what stands still.

    Raises
    ------
    ValueError
        If the image has another shape than the estimate, or the threshold is no such probability.
    """
    image, grid = photograph_of(image), estimate.grid
    if image.shape[:2] != grid.shape:
        raise ValueError(f"expected the photograph of the estimate, {grid.shape}, got {image.shape}")
    if not 0 < threshold < 1:
        raise ValueError(f"the threshold must be a probability above 0 and below 1, got {threshold}")
    rng = np.random.default_rng(0) if rng is None else rng
    return mask_of(estimate.moving or moving_in(image, grid, rng, estimate.execution), image, threshold)


def mask_of(found: Moving, image: AnyArray, threshold: float = THRESHOLD) -> MotionMask:
    """Return the mask of what moves by itself in an image (H, W, 3) or (H, W)."""
    side, still = found.place_px, found.camera_moved < 0.5
    parts = _to_pixels(found.parts(threshold).astype(np.float32), image.shape, side)
    moves = _along_edges(parts, image, side) > 0.5
    del parts  # a large photograph's
    probability = _to_pixels(found.probability, image.shape, side)
    regions = regions_of(moves, probability, LEAST_PLACES * side**2)
    smooth = np.repeat(np.repeat(found.smooth.astype(np.uint8), side, 0), side, 1)
    labels = smooth[: image.shape[0], : image.shape[1]] * np.uint8(MotionLabel.UNOBSERVABLE)  # others static
    labels[moves] = MotionLabel.MOVING
    against = "camera that stands still" if still else f"smooth motion of {found.camera_px:.0f} px (median)"
    return MotionMask(
        labels=labels, probability=probability, regions=regions, reason=f"measured against a {against}"
    )


def _to_pixels(places: Floats, shape: tuple[int, ...], place_px: int) -> Floats:
    """Resample values (h, w) of places, squares of ``place_px`` pixels, to the pixels (H, W) they cover."""
    rows, columns = (-(-side // place_px) for side in shape[:2])
    size = columns * place_px, rows * place_px
    values = cv2.resize(places[:rows, :columns], size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(values[: shape[0], : shape[1]], np.float32)


def _along_edges(values: Floats, image: AnyArray, place_px: int) -> Floats:
    """Return values (H, W) whose steps follow the edges of an image (He, Sun and Tang, ECCV 2010)."""
    grey = image if image.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    grey = np.asarray(grey / np.float32(white_of(image)), np.float32)
    followed = cv2.ximgproc.guidedFilter(grey, values, GUIDE_PLACES, GUIDE_EPS, scale=1 / place_px)
    return np.asarray(followed, np.float32)


def regions_of(moves: Mask, probability: Floats, least_px: int = 1) -> tuple[MovingRegion, ...]:
    """Describe the connected parts of a mask (H, W), largest first, and take smaller ones out of it."""
    count, part, stats, centres = cv2.connectedComponentsWithStats(moves.astype(np.uint8), connectivity=4)
    regions = []
    for k in range(1, count):
        x, y, width, height, area = stats[k].tolist()
        box = slice(y, y + height), slice(x, x + width)
        own = part[box] == k
        if area < least_px:
            moves[box][own] = False
            continue
        regions.append(
            MovingRegion(
                area_px=area,
                box=(x, y, width, height),
                centroid=(float(centres[k, 0]), float(centres[k, 1])),
                probability=float(probability[box][own].mean(dtype=float)),
            )
        )
    return tuple(sorted(regions, key=lambda region: -region.area_px))
