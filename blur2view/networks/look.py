"""A look at a photograph that costs as much as the doubt about it, not as its pixels.

Of every octave the network reads as many windows, about the same points, from an octave of a few hundred
pixels on; finer ones follow until they cannot change the answer.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from blur2view.arrays import AnyArray, Array, Floats
from blur2view.images.pixels import LEVELS_OF_8_BITS, as_floats, brightened, brightness_gain, from_resized
from blur2view.networks.model_file import OnnxNetwork
from blur2view.networks.octaves import (
    FLAT_PX,
    not_short,
    octave_count,
    octave_values,
    read_octave,
    thinned,
    with_flat,
)
from blur2view.networks.spectra import STEP, WINDOW, power_spectra
from blur2view.smears.grid import SmearGrid
from blur2view.smears.likelihood import read_smears
from blur2view.smears.noise import WINDOW_PX

CELLS = 48
"""Windows of an octave, about. Of 911 pictures (DAVIS, RedKitchen, Kodak, phones, cut-outs, rendered and
blurred ones) `estimate` names 21 otherwise than a look of so many windows that is not in doubt, 14 with 96,
and 19 with 80 to 160 in all octaves."""
FIRST_PX = 240
"""Longer side of the first octave, at least: smears up to 8 % of it are within the network's reach."""
SEES_FOCUS = 1
"""Smallest octave in which a lens is seen to be out of focus by 2 px, since its bins begin at 0.7 px: where
smears of 125 to 177 px ended the look in octave 3, three phones' photographs were not named out of focus."""
SAMPLES = 100_000
"""Values of which the brightness is taken; bound."""
WHITE = 65535


def look(network: OnnxNetwork, features: int, image: AnyArray, brightness: float) -> SmearGrid:
    """Return the smears of a photograph (H, W, 3) or (H, W) in some 48 cells, without their shares.

    It is settled when its smears are so long that a finer octave adds nothing to them, or when the photograph
    itself was read: short smears differ from none there alone.
    """
    height, width = image.shape[:2]
    stride = window_stride(height, width)
    first = (stride - 1) / 2
    middles = [np.minimum(np.arange(first, side + first, stride), side - 1) for side in (height, width)]
    rows, columns = (len(middle) for middle in middles)
    middles = [np.repeat(middle, 2 if len(middle) == 1 else 1) for middle in middles]  # the network needs two
    pictures = [_grey(image, brightness_gain(image, brightness, SAMPLES))]
    for _ in range(first_octave(height, width)):
        pictures.append(_halved(pictures[-1]))
    threads, read, flat = network.execution.threads, None, np.ones([len(middle) for middle in middles], bool)
    for k in reversed(range(len(pictures))):
        windows = _windows_about(pictures[k], *(from_resized(middle, 2**k) for middle in middles))
        flat &= _is_flat(windows)
        read = read_octave(network, features, thinned(windows), power_spectra(windows, threads), read, False)
        if k <= SEES_FOCUS and not_short(read):
            break
    assert read is not None
    cells, blur = np.split(octave_values(read, read_smears(read.smears), k), [4], axis=-1)
    cells, blur = (values[:rows, :columns] for values in with_flat(cells, blur, flat))
    return SmearGrid(cells=cells, blur=blur, stride=stride, shape=(height, width), window_px=WINDOW_PX << k)


def window_stride(height: int, width: int) -> int:
    """Return the distance of windows, pixels, at which rows of some `CELLS` in all cover a photograph."""
    rows = max(round(math.sqrt(CELLS * height / width)), 1)
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


def _halved(picture: AnyArray) -> AnyArray:
    """Return the mean of every 2 x 2 pixels of a picture."""
    height, width = (side // 2 for side in picture.shape)
    even = picture[: 2 * height, : 2 * width]
    return np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA))


def _windows_about(picture: AnyArray, rows: Array, columns: Array) -> Floats:
    """Return the windows (h, w, 96, 96) about rows (h,) and columns (w,) of a picture, mirrored beyond it."""
    tops, lefts = (np.rint(middles - (WINDOW - 1) / 2).astype(int) for middles in (rows, columns))
    beyond = [
        max(-firsts[0], firsts[-1] + WINDOW - side, 0)
        for firsts, side in zip((tops, lefts), picture.shape, strict=True)
    ]
    down, across = (int(border) for border in beyond)
    padded = cv2.copyMakeBorder(picture, down, down, across, across, cv2.BORDER_REFLECT_101)
    views = np.lib.stride_tricks.sliding_window_view(padded, (WINDOW, WINDOW))
    windows = np.asarray(views[np.ix_(tops + down, lefts + across)], np.float32)
    return np.asarray(windows / WHITE, np.float32) if picture.dtype == np.uint16 else windows


def _is_flat(windows: Floats) -> AnyArray:
    """Mark the windows (h, w) in whose middle one grey level of 255 or less is all that changes."""
    border = (WINDOW - FLAT_PX) // 2
    middle = windows[..., border : border + FLAT_PX, border : border + FLAT_PX]
    return np.asarray(np.ptp(middle, axis=(-2, -1)) < 1.5 / 255)
