"""Cutting a large photograph into overlapping tiles, and the weights that blend their results."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray


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
    return image[np.ix_(mirrored(rows, height), mirrored(columns, width))]


def mirrored(indices: range, side: int) -> NDArray[np.intp]:
    """Fold indices into 0 ... side-1 without repeating the border: 0 1 2 1 0 1 2 for side 3."""
    period = max(2 * side - 2, 1)
    folded = np.asarray(indices, dtype=np.intp) % period
    return np.minimum(folded, period - folded) if side > 1 else np.zeros_like(folded)
