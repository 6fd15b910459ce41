"""Smears longer than the network measures: smaller copies of the photograph, blended by length."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.smear import upsample_grid

Grid = NDArray[np.float32]
PIXEL_CHANNELS = 3  # double angle and sigma; an angle does not grow with the picture


@dataclass(frozen=True, kw_only=True)
class PyramidOptions:
    """When smaller copies of a photograph are looked at.

    A network measures smears up to some length well (its file says which); in a copy of half the side a smear
    of twice that length is within its reach. From half of that length on the smaller copy's smear counts,
    from the length itself on it counts alone, blended by the logarithm.

    Parameters
    ----------
    levels : int
        Sizes at most, the photograph's own included; 1 for no smaller copies.
    long_share : float
        The smaller copy is looked at where at least this share of the smears is longer than a quarter of the
        network's length, so that short smears cost no time.
    smallest_px : int
        Images with a side below this are not halved.

    Raises
    ------
    ValueError
        Unless ``levels >= 1``, ``smallest_px >= 2`` and `long_share` is in [0, 1].
    """

    levels: int = 4
    long_share: float = 0.02
    smallest_px: int = 192

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.levels < 1 or self.smallest_px < 2 or not 0 <= self.long_share <= 1:
            raise ValueError(
                f"expected levels >= 1, smallest_px >= 2 and long_share in [0, 1], got {self.levels}, "
                f"{self.smallest_px}, {self.long_share}"
            )

    def halves(self, level: int, shape: tuple[int, ...], grid: Grid, longest_px: float) -> bool:
        """Whether the image (H, W, ...) of a level with this grid (h, w, C) is looked at in half its size."""
        if level + 1 >= self.levels or min(shape[:2]) < self.smallest_px:
            return False
        return bool((length_of(grid) > longest_px / 4).mean() >= self.long_share)


def halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a copy (H // 2, W // 2, 3) of an image, 2 x 2 pixels averaged; odd last lines are dropped."""
    height, width = (side // 2 for side in image.shape[:2])
    even = image[: 2 * height, : 2 * width]
    return np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def blended(fine: Grid, coarse: Grid, longest_px: float) -> Grid:
    """Blend the grid (h, w, C) of an image with that of its half, in the former's pixels.

    Channels are the double angle and sigma in pixels, and perhaps that of the direction in radians. The
    smaller grid may end a cell early; its border continues.
    """
    lifted = upsample_grid(np.ascontiguousarray(coarse), 2)
    lifted[..., :PIXEL_CHANNELS] *= 2
    missing = [(0, max(0, fine.shape[axis] - lifted.shape[axis])) for axis in (0, 1)]
    lifted = np.pad(lifted, (*missing, (0, 0)), mode="edge")[: fine.shape[0], : fine.shape[1]]
    return fine + coarse_share(length_of(lifted), longest_px)[..., None] * (lifted - fine)


def coarse_share(length_px: Grid, longest_px: float) -> Grid:
    """Share in [0, 1] of the smaller copy, by the length it gives: none up to a half of `longest_px`."""
    octaves = np.log2(np.maximum(length_px, 1e-3) / longest_px) + 1
    share: Grid = np.clip(octaves, 0, 1).astype(np.float32)
    return share


def length_of(grid: Grid) -> Grid:
    """Smear lengths (h, w) of a grid (h, w, C), pixels."""
    length: Grid = np.hypot(grid[..., 0], grid[..., 1])
    return length
