"""Motion masks: which pixels move by themselves, and masks as other programs read them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from pathlib import Path, PurePath

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from blur2view.arrays import AnyArray, Floats, Mask, white_level
from blur2view.errors import OutputError
from blur2view.movers.moving import THRESHOLD, Moving
from blur2view.smears.camera_motion import has_moved

Grey = NDArray[np.uint8]

MIN_BLOCKS = 25
"""Blocks of the smallest connected piece of a mask; bound."""
GUIDE_BLOCKS, GUIDE_EPS = 2, 0.03
"""Radius of the windows in which outlines follow the picture, blocks; contrast of an edge, levels; bounds."""


class MotionLabel(IntEnum):
    """Label of a pixel of a motion mask."""

    STATIC = 0
    MOVING = 1
    UNOBSERVABLE = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingRegion:
    """One connected part of a photograph that moves by itself."""

    area_px: int
    """Number of its pixels."""
    box: tuple[int, int, int, int]
    """Left, top, width and height, pixels."""
    centroid: tuple[float, float]
    """(x, y), pixels."""
    probability: float
    """Mean probability of moving over it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionMask:
    """Which pixels of a photograph (H, W) move by themselves."""

    labels: NDArray[np.uint8]
    """(H, W) of `MotionLabel`: 0 static, 1 moving, 2 unobservable."""
    probability: Floats
    """(H, W): that a pixel moves, in [0, 1]."""
    regions: tuple[MovingRegion, ...]
    """The connected moving parts, largest first."""
    reason: str
    """The camera's motion that it was measured against."""

    @property
    def shares(self) -> dict[str, float]:
        """Shares of the pixels that are static, moving and unobservable."""
        return {label.name.lower(): float((self.labels == label).mean()) for label in MotionLabel}


def motion_mask(moving: Moving, image: AnyArray, threshold: float = THRESHOLD) -> MotionMask:
    """Return the mask of what moves by itself in a photograph (H, W, 3) or (H, W)."""
    side, still = round(moving.block_px), not has_moved(moving.camera_moved)
    parts = _to_pixels(moving.parts(threshold).astype(np.float32), image.shape, side)
    moves = _along_edges(parts, image, side) > 0.5
    del parts  # of a large photograph it takes as much memory as the picture
    probability = _to_pixels(moving.probability, image.shape, side)
    regions = connected_regions(moves, probability, MIN_BLOCKS * side**2)
    smooth = np.repeat(np.repeat(moving.smooth.astype(np.uint8), side, 0), side, 1)
    labels = smooth[: image.shape[0], : image.shape[1]] * np.uint8(MotionLabel.UNOBSERVABLE)
    labels[moves] = MotionLabel.MOVING
    against = "camera that stands still" if still else f"smooth motion of {moving.camera_px:.0f} px (median)"
    return MotionMask(
        labels=labels,
        probability=probability,
        regions=regions,
        reason=f"motion is measured against a {against}",
    )


def _to_pixels(blocks: Floats, shape: tuple[int, ...], block_px: int) -> Floats:
    """Resample values (h, w) of blocks, squares of ``block_px`` pixels, to the pixels (H, W) they cover."""
    rows, columns = (-(-side // block_px) for side in shape[:2])
    size = columns * block_px, rows * block_px
    values = cv2.resize(blocks[:rows, :columns], size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(values[: shape[0], : shape[1]], np.float32)


def _along_edges(values: Floats, image: AnyArray, block_px: int) -> Floats:
    """Filter values (H, W) so that their steps follow the image's edges (He, Sun and Tang, ECCV 2010)."""
    grey = image if image.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    grey = np.asarray(grey / np.float32(white_level(image)), np.float32)
    followed = cv2.ximgproc.guidedFilter(grey, values, GUIDE_BLOCKS, GUIDE_EPS, scale=1 / block_px)
    return np.asarray(followed, np.float32)


def connected_regions(moves: Mask, probability: Floats, min_px: int = 1) -> tuple[MovingRegion, ...]:
    """Describe the connected parts of a mask (H, W), largest first; erase those below ``min_px`` from it."""
    count, part, stats, centres = cv2.connectedComponentsWithStats(moves.astype(np.uint8), connectivity=4)
    regions = []
    for k in range(1, count):
        x, y, width, height, area = stats[k].tolist()
        box = slice(y, y + height), slice(x, x + width)
        own = part[box] == k
        if area < min_px:
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


GREY = np.zeros(3, np.uint8)
GREY[[MotionLabel.STATIC, MotionLabel.MOVING, MotionLabel.UNOBSERVABLE]] = 0, 255, 128
"""Grey of each `MotionLabel` in ``*.mask.png``."""
DAMAGED = (OSError, ValueError, SyntaxError, Image.DecompressionBombError)
"""Errors of Pillow on a picture that it cannot read."""


class MaskFormat(StrEnum):
    """A program that reads masks.

    COLMAP (``--ImageReader.mask_path``) and Nerfstudio (``mask_path`` of a frame) ignore pixels that are 0,
    instant-ngp the others. All read photographs and masks as their pixels are stored, without EXIF's
    orientation: their masks are turned by `blur2view.images.pixels.stored_from_upright`.
    """

    COLMAP = "colmap"
    NERFSTUDIO = "nerfstudio"
    INSTANT_NGP = "instant-ngp"

    def path(self, photograph: PurePath) -> PurePath:
        """Return the mask's path below the folder of masks; for instant-ngp beside the photograph."""
        stem = photograph.stem
        names = {
            self.COLMAP: photograph.name,
            self.NERFSTUDIO: stem,
            self.INSTANT_NGP: f"dynamic_mask_{stem}",
        }
        return photograph.parent / f"{names[self]}.png"

    def picture(self, labels: Grey) -> Grey:
        """Return the mask (H, W), 0 or 255, of labels (H, W)."""
        marked = (labels == MotionLabel.MOVING) == (self is MaskFormat.INSTANT_NGP)
        return np.where(marked, 255, 0).astype(np.uint8)


def stored_labels(path: Path) -> Grey:
    """Return the labels (H, W) of a file ``*.mask.png``; OutputError if it is not one."""
    try:
        with Image.open(path, formats=["PNG"]) as picture:
            grey = np.asarray(picture.convert("L"))  # optimisers make it of 1 bit, or a palette
    except DAMAGED:
        grey = np.zeros(0, np.uint8)
    if grey.ndim != 2 or not np.isin(grey, GREY).all():
        raise OutputError(f"{path}: is not a mask of blur2view segment; segment the photograph again")
    label_by_grey = np.zeros(256, np.uint8)
    label_by_grey[GREY] = np.arange(len(GREY))
    return np.asarray(label_by_grey[grey])
