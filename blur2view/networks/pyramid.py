"""A second look at a photograph in half its size: for long smears, and as another opinion on directions."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.smears.field import upsample_grid

Grid = NDArray[np.float32]
PIXEL_CHANNELS = 3  # double angle and sigma; an angle does not grow with the picture
CANCELLED = 1e-3  # length of the mean of two unit vectors below which it has no direction
TINY_PX = 1e-2  # added to lengths before their logarithm


@dataclass(frozen=True, kw_only=True)
class PyramidOptions:
    """Which smaller copies of a photograph are looked at.

    A network measures smears up to some length well (its file says which); in a copy of half the side a smear
    of twice that length is within its reach, and for others the copy is another opinion. Lengths come from
    the image itself up to a half of that length, and from the copy from the whole of it on (by the copy's
    lengths). Directions are averaged, by the inverse squares of their sigmas. (Averaging lengths, too, makes
    smears better, and F worse: coarse lengths of short smears are biased.)

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


def blended(fine: Grid, coarse: Grid, longest_px: float) -> Grid:
    """Blend the grid (h, w, C) of an image with that of its half, in the former's pixels.

    Channels are the double angle and sigma in pixels, and perhaps that of the direction in radians. The
    smaller grid may end a cell early; its border continues.
    """
    lifted = upsample_grid(np.ascontiguousarray(coarse), 2)
    lifted[..., :PIXEL_CHANNELS] *= 2
    missing = [(0, max(0, fine.shape[axis] - lifted.shape[axis])) for axis in (0, 1)]
    lifted = np.pad(lifted, (*missing, (0, 0)), mode="edge")[: fine.shape[0], : fine.shape[1]]
    long = long_share(length_of(lifted), longest_px)
    direction, share = unit_of(fine), direction_share(fine, lifted, long)[..., None]
    direction = mean_direction(direction, unit_of(lifted), share)
    logs = [np.log(length_of(grid) + TINY_PX) for grid in (fine, lifted)]
    length = np.exp(logs[0] + long * (logs[1] - logs[0])) - TINY_PX
    sigma_px = fine[..., 2] + long * (lifted[..., 2] - fine[..., 2])
    sigma_rad = fine[..., 3:] + share * (lifted[..., 3:] - fine[..., 3:])
    return np.dstack([direction * length[..., None], sigma_px, sigma_rad]).astype(np.float32)


def long_share(length_px: Grid, longest_px: float) -> Grid:
    """Share in [0, 1] of the smaller copy by the length it gives: none up to a half of `longest_px`."""
    octaves = np.log2(np.maximum(length_px, 1e-3) / longest_px) + 1
    share: Grid = np.clip(octaves, 0, 1).astype(np.float32)
    return share


def direction_share(fine: Grid, lifted: Grid, long: Grid) -> Grid:
    """Share in [0, 1] of the smaller copy's direction: by certainty, and at least that of its length."""
    if fine.shape[2] == PIXEL_CHANNELS:  # a network that does not tell
        return long
    mine, theirs = (np.maximum(grid[..., 3], 1e-3) ** -2 for grid in (fine, lifted))
    share: Grid = np.maximum(theirs / (mine + theirs), long).astype(np.float32)
    return share


def mean_direction(first: Grid, second: Grid, share: Grid) -> Grid:
    """Average double angles (h, w, 2), share (h, w, 1) of the second; where they cancel the surer counts."""
    mean = first + share * (second - first)
    cancelled = np.hypot(mean[..., :1], mean[..., 1:]) < CANCELLED
    return unit_of(np.where(cancelled, np.where(share > 0.5, second, first), mean))


def unit_of(grid: Grid) -> Grid:
    """Double angles (h, w, 2) of a grid (h, w, C), of length one; zero stays zero."""
    length = np.maximum(length_of(grid), np.float32(1e-6))
    unit: Grid = (grid[..., :2] / length[..., None]).astype(np.float32)
    return unit


def length_of(grid: Grid) -> Grid:
    """Smear lengths (h, w) of a grid (h, w, C), pixels."""
    length: Grid = np.hypot(grid[..., 0], grid[..., 1])
    return length
