"""Smears on a network's own grid, and as they are at every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blur2view.smears.field import SmearField, from_double_angle, upsample_grid

# Grid rows decoded to pixels at a time: bounds the temporaries of a large photograph.
_STRIP_CELLS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearGrid:
    """Smears and their uncertainty at the cells of a grid: all that a network says of a photograph.

    Parameters
    ----------
    cells : ndarray of shape (h, w, 3 or 4), float32
        Double angle |d| (cos 2phi, sin 2phi), pixels; ``sigma_px``; where the network predicts it
        ``sigma_rad``, both as of `SmearField`.
    stride : int
        Pixels per cell; cell j's centre is at pixel stride*j + (stride-1)/2.
    shape : (int, int)
        Height and width of the photograph, whose last cells its border may cut.

    Raises
    ------
    ValueError
        If the cells do not cover a photograph of this shape.
    """

    cells: NDArray[np.float32]
    stride: int
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        """Check the shapes."""
        covered = tuple(-(-side // self.stride) for side in self.shape) if self.stride > 0 else ()
        if self.cells.ndim != 3 or self.cells.shape[:2] != covered or self.cells.shape[2] not in (3, 4):
            got = f"{self.cells.shape}, stride {self.stride} and shape {self.shape}"
            raise ValueError(f"expected cells (h, w, 3 or 4) that cover a photograph, got {got}")

    def at_pixels(self) -> SmearField:
        """Return the smears of every pixel: resampled in double angle and decoded, a strip at a time."""
        grid, stride, (height, width) = self.cells, self.stride, self.shape
        displacement = np.empty((height, width, 2), np.float32)
        sigmas = [np.empty((height, width), np.float32) for _ in range(grid.shape[2] - 2)]
        for first in range(0, grid.shape[0], _STRIP_CELLS):
            above = max(first - 1, 0)  # one more row on each side, so that strips join without a seam
            pixels = upsample_grid(grid[above : first + _STRIP_CELLS + 1], stride)[(first - above) * stride :]
            rows = slice(first * stride, min((first + _STRIP_CELLS) * stride, height))
            strip = pixels[: rows.stop - rows.start, :width]
            displacement[rows] = from_double_angle(strip[..., :2])
            for k, sigma in enumerate(sigmas):
                np.maximum(strip[..., 2 + k], 0, out=sigma[rows])
        return SmearField(
            displacement=displacement, sigma_px=sigmas[0], sigma_rad=sigmas[1] if sigmas[1:] else None
        )
