"""A second look at a photograph in half its size: for long smears, and as another opinion on short ones."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.smear import upsample_grid

Grid = NDArray[np.float32]
PIXEL_CHANNELS = 3  # double angle and sigma; an angle does not grow with the picture
SHORT_PX = 2.0  # added to lengths, so that the weight of a smear of no length is finite


@dataclass(frozen=True, kw_only=True)
class PyramidOptions:
    """Which smaller copies of a photograph are looked at.

    A network measures smears up to some length well (its file says which); in a copy of half the side a smear
    of twice that length is within its reach, and for others the copy is a second opinion. Each cell's smears
    are averaged by the inverse squares of their relative sigmas.

    Parameters
    ----------
    levels : int
        Sizes at most, the photograph's own included; 1 for no smaller copies.
    long_share : float
        A copy of a quarter of the side or less is looked at where at least this share of the smears of the
        next larger one is longer than a quarter of the network's length.
    smallest_px : int
        Images with a side below this are not halved.

    Raises
    ------
    ValueError
        Unless ``levels >= 1``, ``smallest_px >= 2`` and `long_share` is in [0, 1].
    """

    levels: int = 4
    long_share: float = 0.25
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
        return level == 0 or bool((length_of(grid) > longest_px / 4).mean() >= self.long_share)


def halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a copy (H // 2, W // 2, 3) of an image, 2 x 2 pixels averaged; odd last lines are dropped."""
    height, width = (side // 2 for side in image.shape[:2])
    even = image[: 2 * height, : 2 * width]
    return np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def blended(fine: Grid, coarse: Grid) -> Grid:
    """Average the grid (h, w, C) of an image with that of its half, in the former's pixels.

    Channels are the double angle and sigma in pixels, and perhaps that of the direction in radians. The
    smaller grid may end a cell early; its border continues.
    """
    lifted = upsample_grid(np.ascontiguousarray(coarse), 2)
    lifted[..., :PIXEL_CHANNELS] *= 2
    missing = [(0, max(0, fine.shape[axis] - lifted.shape[axis])) for axis in (0, 1)]
    lifted = np.pad(lifted, (*missing, (0, 0)), mode="edge")[: fine.shape[0], : fine.shape[1]]
    mine, theirs = weight_of(fine), weight_of(lifted)
    mixed: Grid = fine + (theirs / (mine + theirs))[..., None] * (lifted - fine)
    return mixed


def weight_of(grid: Grid) -> Grid:
    """Weigh the smears (h, w) of a grid: the inverse square of sigma over length."""
    relative = np.maximum(grid[..., 2], 1e-3) / (length_of(grid) + SHORT_PX)
    weight: Grid = relative**-2
    return weight


def length_of(grid: Grid) -> Grid:
    """Smear lengths (h, w) of a grid (h, w, C), pixels."""
    length: Grid = np.hypot(grid[..., 0], grid[..., 1])
    return length
