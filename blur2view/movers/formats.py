"""Masks as other programs read them: 8-bit grey, what moves left out."""

from __future__ import annotations

from contextlib import suppress
from enum import StrEnum
from pathlib import Path, PurePath
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image

from blur2view.errors import OutputError
from blur2view.movers.mask import MotionLabel

Grey = NDArray[np.uint8]

GREY = np.zeros(3, np.uint8)
GREY[[MotionLabel.STATIC, MotionLabel.MOVING, MotionLabel.UNOBSERVABLE]] = 0, 255, 128
"""Grey of every `MotionLabel` in ``*.mask.png``."""
DAMAGED = (OSError, ValueError, SyntaxError, Image.DecompressionBombError)
"""What Pillow raises of a picture that it cannot read."""


class MaskFormat(StrEnum):
    """A program that reads masks.

    COLMAP (``--ImageReader.mask_path``) and Nerfstudio (``mask_path`` of a frame) leave out what is 0,
    instant-ngp what is not. All read photographs and masks as their pixels are stored, whatever EXIF says of
    the orientation: masks for them are `as_stored`.
    """

    COLMAP = "colmap"
    NERFSTUDIO = "nerfstudio"
    INSTANT_NGP = "instant-ngp"

    def path(self, photograph: PurePath) -> PurePath:
        """Return where the program looks for the mask: below a folder of masks; instant-ngp beside it."""
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
    """Return the labels (H, W) of a file ``*.mask.png``; OutputError if it is no such file."""
    try:
        with Image.open(path, formats=["PNG"]) as picture:
            grey = np.asarray(picture)
    except DAMAGED:
        grey = np.zeros(0, np.uint8)
    if grey.ndim != 2 or not np.isin(grey, GREY).all():
        raise OutputError(f"{path}: is no mask of blur2view segment; segment the photograph again")
    label_of = np.zeros(256, np.uint8)
    label_of[GREY] = np.arange(len(GREY))
    return np.asarray(label_of[grey])


def as_stored(upright: Grey, photograph: Path | BinaryIO) -> Grey:
    """Return a mask of the upright photograph as its pixels are stored, by EXIF (2.3, tag 0x0112)."""
    orientation = 1
    with suppress(*DAMAGED), Image.open(photograph, formats=("JPEG", "PNG", "TIFF", "WEBP")) as picture:
        orientation = picture.getexif().get(ExifTags.Base.Orientation, 1)
    if orientation in (3, 4, 7, 8):
        upright = upright[::-1]
    if orientation in (2, 3, 6, 7):
        upright = upright[:, ::-1]
    return upright.swapaxes(0, 1) if orientation in (5, 6, 7, 8) else upright
