"""Smears at the cells of a network's grid: all that it says of a photograph, and sampled anywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.smears.blur_kinds import KINDS, OUT_OF_FOCUS, SHARP
from blur2view.smears.field import SmearField, from_double_angle, upsample_grid
from blur2view.smears.noise import INDEPENDENT, WINDOW_PX, NoiseModel, of_kinds

# Grid rows decoded to pixels at a time: bounds the temporaries of a large photograph.
_STRIP_CELLS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearGrid:
    """Smears and their uncertainty at the cells of a grid: all that a network says of a photograph.

    Parameters
    ----------
    cells : ndarray of shape (h, w, 4), float32
        Double angle |d| (cos 2phi, sin 2phi), pixels; ``sigma_px`` and ``sigma_rad``, as of `SmearField`.
    stride : int
        Pixels per cell; cell j's centre is at pixel stride*j + (stride-1)/2.
    shape : (int, int)
        Height and width of the photograph, whose last cells its border may cut.
    window_px : int or None
        Side of the window that a cell is read from, pixels; None for smears that err each for itself.
    blur : ndarray of shape (h, w, 6), float32, optional
        Radius out of focus, pixels, and the probabilities of the kinds of blur of
        `blur2view.smears.blur_kinds.KINDS`; None where only smears are known.
    shares : ndarray of shape (h, w, 64), float32, optional
        Probabilities of 32 directions and of 32 lengths of the smears (`blur2view.smears.likelihood`), in
        pixels of a picture in which a cell has 32; None where no photograph was read.

    Raises
    ------
    ValueError
        If the cells do not cover a photograph of this shape.
    """

    cells: NDArray[np.float32]
    stride: int
    shape: tuple[int, int]
    window_px: int | None = WINDOW_PX
    blur: NDArray[np.float32] | None = None
    shares: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        covered = tuple(-(-side // self.stride) for side in self.shape) if self.stride > 0 else ()
        if self.cells.ndim != 3 or self.cells.shape != (*covered, 4):
            got = f"{self.cells.shape}, stride {self.stride} and shape {self.shape}"
            raise ValueError(f"expected cells (h, w, 4) that cover a photograph, got {got}")
        if self.blur is not None and self.blur.shape != (*covered, 1 + len(KINDS)):
            raise ValueError(f"expected blur (h, w, {1 + len(KINDS)}) of the cells, got {self.blur.shape}")

    def __repr__(self) -> str:
        rows, columns, _ = self.cells.shape
        return f"<SmearGrid of {self.shape[1]}x{self.shape[0]} px in {columns}x{rows} cells>"

    @property
    def radius_px(self) -> NDArray[np.float32] | None:
        """Radii out of focus of the cells, (h, w), pixels."""
        return None if self.blur is None else self.blur[..., 0]

    @property
    def kinds(self) -> NDArray[np.float32] | None:
        """Probabilities of the kinds of blur of the cells, (h, w, 5)."""
        return None if self.blur is None else self.blur[..., 1:]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the photograph."""
        return self.shape[1], self.shape[0]

    def shared_errors(self, spacing_px: float) -> NoiseModel:
        """Return what the errors of cells have in common, one every ``spacing_px`` pixels."""
        return INDEPENDENT if self.window_px is None else NoiseModel.of_cells(spacing_px, self.window_px)

    @property
    def sigma_px(self) -> NDArray[np.float32]:
        """Standard deviations of the cells' smears, (h, w), pixels: `noise.of_kinds`."""
        smears = self.smears()
        if self.kinds is None:
            return smears.sigma_px
        return of_kinds(smears.length_px, smears.sigma_px, self.kinds[..., [SHARP, OUT_OF_FOCUS]].sum(-1))

    def points(self) -> Array:
        """Return the centres of the cells, (h, w, 2), pixels (x, y); the last may lie beyond the border."""
        y, x = (self.stride * np.arange(count) + (self.stride - 1) / 2 for count in self.cells.shape[:2])
        return np.stack(np.meshgrid(x, y), axis=-1)

    def smears(self) -> SmearField:
        """Return the smears of the cells themselves, (h, w)."""
        return _decoded(self.cells)

    def at(self, points: Array) -> SmearField:
        """Return the smears at pixels (N, 2), interpolated in double angle between the four nearest cells.

        Beyond the outermost centres the nearest cell continues.
        """
        height, width = self.cells.shape[:2]
        place = (np.asarray(points, float) - (self.stride - 1) / 2) / self.stride
        column, row = np.clip(place, 0, [width - 1, height - 1]).T
        left, top = np.floor(column).astype(int), np.floor(row).astype(int)
        right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
        across, down = (column - left)[:, None], (row - top)[:, None]
        above = (1 - across) * self.cells[top, left] + across * self.cells[top, right]
        below = (1 - across) * self.cells[bottom, left] + across * self.cells[bottom, right]
        return _decoded(((1 - down) * above + down * below).astype(np.float32))

    def at_pixels(self) -> SmearField:
        """Return the smears of every pixel, (H, W): resampled in double angle, a strip at a time."""
        grid, stride, (height, width) = self.cells, self.stride, self.shape
        displacement = np.empty((height, width, 2), np.float32)
        sigmas = [np.empty((height, width), np.float32) for _ in range(2)]
        for first in range(0, grid.shape[0], _STRIP_CELLS):
            above = max(first - 1, 0)  # one more row on each side, so that strips join without a seam
            pixels = upsample_grid(grid[above : first + _STRIP_CELLS + 1], stride)[(first - above) * stride :]
            rows = slice(first * stride, min((first + _STRIP_CELLS) * stride, height))
            strip = pixels[: rows.stop - rows.start, :width]
            displacement[rows] = from_double_angle(strip[..., :2])
            for k, sigma in enumerate(sigmas):
                np.maximum(strip[..., 2 + k], 0, out=sigma[rows])
        return SmearField(displacement=displacement, sigma_px=sigmas[0], sigma_rad=sigmas[1])


def _decoded(cells: NDArray[np.float32]) -> SmearField:
    """Return the smears of cells (..., 4)."""
    sigma_px, sigma_rad = np.moveaxis(np.maximum(cells[..., 2:], 0), -1, 0)
    displacement = from_double_angle(cells[..., :2])
    return SmearField(displacement=displacement, sigma_px=sigma_px, sigma_rad=sigma_rad)
