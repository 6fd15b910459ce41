"""Masks as other programs read them: 8-bit grey, what moves left out."""

from __future__ import annotations

from enum import StrEnum
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from blur2view.segmentation.mask import MotionLabel

GREY = np.zeros(3, np.uint8)
GREY[[MotionLabel.STATIC, MotionLabel.MOVING, MotionLabel.UNOBSERVABLE]] = 0, 255, 128
"""Grey of every `MotionLabel` in ``*.mask.png``."""


class MaskFormat(StrEnum):
    """A program that reads masks.

    COLMAP (``--ImageReader.mask_path``) and Nerfstudio (``mask_path`` of a frame) leave out what is 0,
    instant-ngp what is not.
    """

    COLMAP = "colmap"
    NERFSTUDIO = "nerfstudio"
    INSTANT_NGP = "instant-ngp"

    def path(self, photograph: PurePath) -> PurePath:
        """Return where the program looks for the mask of a photograph, below a folder of masks.

        instant-ngp looks beside the photograph.
        """
        if self is MaskFormat.COLMAP:
            return photograph.parent / f"{photograph.name}.png"
        if self is MaskFormat.NERFSTUDIO:
            return photograph.parent / f"{photograph.stem}.png"
        return photograph.parent / f"dynamic_mask_{photograph.stem}.png"

    def picture(self, labels: NDArray[np.uint8], *, ignore_unobservable: bool) -> NDArray[np.uint8]:
        """Return the mask (H, W), 0 or 255, of labels (H, W)."""
        ignored = labels == MotionLabel.MOVING
        if ignore_unobservable:
            ignored |= labels == MotionLabel.UNOBSERVABLE
        if self is not MaskFormat.INSTANT_NGP:
            ignored = ~ignored
        return np.where(ignored, 255, 0).astype(np.uint8)
