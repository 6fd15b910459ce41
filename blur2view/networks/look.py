"""A look at a photograph that costs as much as the doubt about it, not as its pixels.

Of every octave the network reads as many windows, about the same points, from an octave of a few hundred
pixels on; finer ones follow until they cannot change the answer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from blur2view.arrays import AnyArray, Array, Floats
from blur2view.images.pixels import LEVELS_OF_8_BITS, as_floats, brightened, brightness_gain, from_resized
from blur2view.networks.model_file import OnnxNetwork
from blur2view.networks.octaves import (
    FLAT_PX,
    LENGTHS,
    not_short,
    octave_count,
    octave_values,
    read_octave,
    thinned,
    with_flat,
)
from blur2view.networks.spectra import STEP, WINDOW, power_spectra
from blur2view.smears.grid import SmearGrid
from blur2view.smears.likelihood import marginals, read_smears
from blur2view.smears.noise import WINDOW_PX

CELLS = 48
"""Windows of an octave of the first look, about. Of 104 photographs (every second of DAVIS, RedKitchen, Kodak
and real ones) 16 ask for more, and none has another name than `estimate` gives, which names those of more
than `NAMED_WHOLE_PX` by the same look; with 96 windows 25 ask for more, which takes 1.6 times as long
(``tools.evaluation.looks FOLDERS --cells 48 96 --every 2``)."""
CLOSER_CELLS = 96
"""Windows of an octave of a closer look, from which movers are looked for in a copy of as many cells. Of 178
pictures of 1280x1024 (12 photographs blurred as for `tools.evaluation.blur_kinds`, and 46 sharp ones) every
second one chose it: of the others it names 82 of 89 rightly, 192 windows 80, and all windows 75
(``tools.evaluation.looks PHOTOGRAPHS --sides 1280 --closer 96 192`` compares them)."""
FIRST_PX = 240
"""Longer side of the first octave, at least: smears up to 8 % of it are within the network's reach."""
SEES_FOCUS = 1
"""Smallest octave in which a lens is seen to be out of focus by 2 px, since its bins begin at 0.7 px: where
smears of 125 to 177 px ended the look in octave 3, three phones' photographs were not named out of focus."""
SAMPLES = 100_000
"""Values of which the brightness is taken; bound."""
WHITE = 65535
STRIP_ROWS = 64  # of the photograph, even: `_grey` of so many rows is held at a time


def look(
    network: OnnxNetwork,
    features: int,
    image: AnyArray,
    brightness: float,
    cells: int = CELLS,
    *,
    shares: bool,
) -> SmearGrid:
    """Return the smears of a photograph (H, W, 3) or (H, W) in about so many cells, and ``shares`` if asked.

    It is settled when its smears are so long that a finer octave adds nothing to them, or when the photograph
    itself was read: short smears differ from none there alone.
    """
    height, width = image.shape[:2]
    stride = window_stride(height, width, cells)
    first = (stride - 1) / 2
    middles = [np.minimum(np.arange(first, side + first, stride), side - 1) for side in (height, width)]
    rows, columns = (len(middle) for middle in middles)
    middles = [np.repeat(middle, 2 if len(middle) == 1 else 1) for middle in middles]  # the network needs two
    gain, count = brightness_gain(image, brightness, SAMPLES), first_octave(height, width)
    smaller = [_half_grey(image, gain)] if count else []
    for _ in range(count - 1):
        smaller.append(_halved(smaller[-1]))
    threads, read, flat = network.execution.threads, None, np.ones([len(middle) for middle in middles], bool)
    for k in reversed(range(count + 1)):
        about = [np.asarray(from_resized(middle, 2**k), float) for middle in middles]
        windows = _windows_about(smaller[k - 1], about) if k else _windows_about(image, about, gain)
        flat &= _is_flat(windows)
        read = read_octave(network, features, thinned(windows), power_spectra(windows, threads), read, False)
        if k <= SEES_FOCUS and not_short(read):
            break
    assert read is not None
    smears, blur = np.split(octave_values(read, read_smears(read.smears), k), [4], axis=-1)
    smears, blur = (values[:rows, :columns] for values in with_flat(smears, blur, flat))
    each = marginals(read.smears, LENGTHS, math.log2(stride / STEP) - k)[:rows, :columns] if shares else None
    window_px, shape = WINDOW_PX << k, (height, width)
    return SmearGrid(cells=smears, blur=blur, shares=each, stride=stride, shape=shape, window_px=window_px)


def window_stride(height: int, width: int, cells: int = CELLS) -> int:
    """Return the distance of windows, pixels, at which rows of some cells in all cover a photograph."""
    rows = max(round(math.sqrt(cells * height / width)), 1)
    return max(-(-height // rows), STEP)


def first_octave(height: int, width: int) -> int:
    """Return the number of the smallest octave that is read; the photograph is number 0."""
    halvings = int(math.log2(max(height, width, FIRST_PX) / FIRST_PX))
    return min(halvings, octave_count(min(height, width)) - 1)


def _grey(image: AnyArray, gain: float) -> AnyArray:
    """Return the luma of a photograph times ``gain``: 16 bits of one of 8 bits, else float32 in [0, 1].

    An octave of 8 bits would be rounded as coarsely as the photograph, which it is the mean of.
    """
    if image.dtype != np.uint8:
        return np.asarray(cv2.cvtColor(as_floats(image, gain), cv2.COLOR_RGB2GRAY))
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    table = np.rint(WHITE * brightened(LEVELS_OF_8_BITS, gain)).astype(np.uint16)
    return np.asarray(cv2.LUT(np.ascontiguousarray(grey), table))


def _half_grey(image: AnyArray, gain: float) -> AnyArray:
    """Return `_grey` of a photograph, `_halved`, so that memory never holds all of it."""
    strips = range(0, image.shape[0] // 2 * 2, STRIP_ROWS)
    return np.concatenate([_halved(_grey(image[first : first + STRIP_ROWS], gain)) for first in strips])


def _halved(picture: AnyArray) -> AnyArray:
    """Return the mean of every 2 x 2 pixels of a picture."""
    height, width = (side // 2 for side in picture.shape)
    even = picture[: 2 * height, : 2 * width]
    return np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA))


def _windows_about(picture: AnyArray, middles: Sequence[Array], gain: float | None = None) -> Floats:
    """Return the windows (h, w, 96, 96) about rows (h,) and columns (w,) of a picture, mirrored beyond it.

    With a ``gain`` the picture is a photograph, of which `_grey` is taken.
    """
    lines = []
    for middle, side in zip(middles, picture.shape[:2], strict=True):
        firsts = np.rint(middle - (WINDOW - 1) / 2).astype(int)
        period = max(2 * (side - 1), 1)  # of the picture and its mirror image
        at = np.abs(firsts[:, None] + np.arange(WINDOW)) % period
        lines.append(np.minimum(at, period - at).ravel())
    shown = picture[lines[0]]
    if gain is not None:
        shown = _grey(shown, gain)  # whole rows: to pick columns of three colours takes eight times as long
    shown = shown[:, lines[1]]
    windows = shown.reshape(len(middles[0]), WINDOW, len(middles[1]), WINDOW).swapaxes(1, 2)
    scale = WHITE if shown.dtype == np.uint16 else 1
    return np.ascontiguousarray(windows, np.float32) / np.float32(scale)


def _is_flat(windows: Floats) -> AnyArray:
    """Mark the windows (h, w) in whose middle one grey level of 255 or less is all that changes."""
    border = (WINDOW - FLAT_PX) // 2
    middle = windows[..., border : border + FLAT_PX, border : border + FLAT_PX]
    return np.asarray(np.ptp(middle, axis=(-2, -1)) < 1.5 / 255)
