"""Cutting a large photograph into overlapping tiles, and the weights that blend their results."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class TileOptions:
    """When and how a photograph is cut into tiles; a smear is then measured from its own tile alone.

    Parameters
    ----------
    max_pixels : int
        Photographs up to this many pixels go through the network in one piece.
    tile_px : int
        Side of a tile, rounded up to what the network needs.
    overlap_px : int
        Pixels shared by neighbouring tiles, over which they are blended.

    Raises
    ------
    ValueError
        Unless ``0 <= 2 * overlap_px <= tile_px``, ``tile_px`` and ``max_pixels`` are positive.
    """

    max_pixels: int = 2_500_000  # 1920x1080 in one piece
    tile_px: int = 1280
    overlap_px: int = 256

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.max_pixels < 1 or self.tile_px < 1:
            raise ValueError(f"max_pixels, tile_px must be positive, got {self.max_pixels}, {self.tile_px}")
        if not 0 <= 2 * self.overlap_px <= self.tile_px:
            raise ValueError(f"overlap_px must be 0 to tile_px / 2, got {self.overlap_px} of {self.tile_px}")


def spans(side: int, step: int, options: TileOptions | None) -> list[range]:
    """Return pixel spans of equal size that cover a side padded to a multiple of step; one without options.

    Starts are multiples of step, so that the network's grid is the same in every tile.
    """
    padded = -(-side // step) * step
    if options is None:
        return [range(padded)]
    tile = min(-(-options.tile_px // step) * step, padded)
    advance = max((tile - options.overlap_px) // step * step, step)
    count = 1 + -(-(padded - tile) // advance)
    starts = np.linspace(0, (padded - tile) // step, count).astype(int) * step
    return [range(start, start + tile) for start in starts.tolist()]


def cells(span: range, stride: int) -> slice:
    """Return the grid cells of a span of pixels."""
    return slice(span.start // stride, span.stop // stride)


def ramps(spans: list[range], stride: int) -> Iterator[tuple[range, NDArray[np.float32]]]:
    """Yield each span with its weights per cell: one, and smooth ramps over the overlaps with neighbours."""
    for index, span in enumerate(spans):
        weight = np.ones(len(span) // stride, np.float32)
        if index > 0 and (shared := (spans[index - 1].stop - span.start) // stride) > 0:
            weight[:shared] *= _ramp(shared)
        if index + 1 < len(spans) and (shared := (span.stop - spans[index + 1].start) // stride) > 0:
            weight[-shared:] *= _ramp(shared)[::-1]
        yield span, weight


def _ramp(count: int) -> NDArray[np.float32]:
    """Return a rise from above 0 to below 1 whose reverse is its complement (raised cosine)."""
    phase = np.pi * (np.arange(count) + 0.5) / count
    return ((1 - np.cos(phase)) / 2).astype(np.float32)


def reflected(image: NDArray[np.float32], rows: range, columns: range) -> NDArray[np.float32]:
    """Return a window of the image, which continues as its mirror image beyond the right and lower border."""
    height, width = image.shape[:2]
    if rows.stop <= height and columns.stop <= width:
        return image[rows.start : rows.stop, columns.start : columns.stop]
    return image[np.ix_(_mirror(rows, height), _mirror(columns, width))]


def _mirror(indices: range, side: int) -> NDArray[np.intp]:
    """Fold indices into 0 ... side-1 without repeating the border: 0 1 2 1 0 1 2 for side 3."""
    period = max(2 * side - 2, 1)
    folded = np.asarray(indices, dtype=np.intp) % period
    return np.minimum(folded, period - folded) if side > 1 else np.zeros_like(folded)
