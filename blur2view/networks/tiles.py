"""Cutting a large photograph into overlapping tiles, and the weights that blend their results."""

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


class Tile(NamedTuple):
    """Where a tile lies, in pixels and in cells, and the weights (h, w) of its cells."""

    pixels: tuple[slice, slice]
    cells: tuple[slice, slice]
    weight: Floats

    def of(self, image: Floats) -> Floats:
        """Return its part of a picture (H, W), which continues mirrored beyond the right and lower border."""
        part = image[self.pixels]
        down, right = (axis.stop - axis.start - n for axis, n in zip(self.pixels, part.shape, strict=True))
        if not (down or right):
            return part
        return np.asarray(cv2.copyMakeBorder(part, 0, down, 0, right, cv2.BORDER_REFLECT_101), np.float32)


def tiles_of(sides: tuple[int, int], step: int, tile_px: int, overlap_px: int, stride: int) -> list[Tile]:
    """Return the tiles that cover a picture of these height and width, in cells of ``stride`` pixels."""
    down, along = (list(ramps(spans(side, step, tile_px, overlap_px), stride)) for side in sides)
    return [
        Tile(
            pixels=(slice(row.start, row.stop), slice(column.start, column.stop)),
            cells=(
                slice(row.start // stride, row.stop // stride),
                slice(column.start // stride, column.stop // stride),
            ),
            weight=np.outer(row_weight, column_weight),
        )
        for (row, row_weight), (column, column_weight) in product(down, along)
    ]


def spans(side: int, step: int, tile_px: int, overlap_px: int) -> list[range]:
    """Return pixel spans of equal size that cover a side padded to a multiple of step, and overlap.

    Starts are multiples of step, so that the network's grid is the same in every tile; so is the size, which
    is rounded up.
    """
    padded = -(-side // step) * step
    tile = min(-(-tile_px // step) * step, padded)
    advance = max((tile - overlap_px) // step * step, step)
    count = 1 + -(-(padded - tile) // advance)
    starts = np.linspace(0, (padded - tile) // step, count).astype(int) * step
    return [range(start, start + tile) for start in starts.tolist()]


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
