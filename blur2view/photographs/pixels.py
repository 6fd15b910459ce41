"""The pixels of a decoded photograph as an array, in the bits of its file, upright."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from blur2view.errors import ImageError

Pixels = NDArray[np.uint8] | NDArray[np.uint16]
STRIP_ROWS = 256
"""Rows copied at a time."""


def pixels_of(path: Path, photo: Image.Image) -> tuple[Pixels, int]:
    """Return pixels as grey, grey + alpha, RGB or RGBA, and the value that means white."""
    if photo.mode.startswith("I"):  # 16-bit grey: I;16 and its byte orders; I for PNG in some versions
        grey = np.asarray(photo)
        if grey.min() < 0 or grey.max() > 65535:
            raise ImageError(f"{path}: has 32-bit integer pixels; save it with 8 or 16 bits per channel")
        return grey.astype(np.uint16), 65535
    if photo.mode == "F":
        raise ImageError(f"{path}: has floating-point pixels; save it with 8 or 16 bits per channel")
    mode = "RGBA" if photo.has_transparency_data else "RGB"
    if photo.mode != mode:
        photo = photo.convert(mode)
    width, height = photo.size
    pixels = np.empty((height, width, len(mode)), np.uint8)
    for top in range(0, height, STRIP_ROWS):  # at once Pillow would take as much again, twice
        below = min(top + STRIP_ROWS, height)
        pixels[top:below] = np.asarray(photo.crop((0, top, width, below)))
    return pixels, 255


def decode_deep(encoded: bytes) -> Pixels:
    """Return 16-bit colour, decoded, (H, W, 3) or (H, W, 4), RGB order."""
    pixels: Any = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype != np.uint16 or pixels.ndim != 3:
        raise ValueError("its 16-bit pixels cannot be decoded")
    return np.concatenate([pixels[..., 2::-1], pixels[..., 3:]], axis=-1)


def upright(pixels: Pixels, orientation: int) -> Pixels:
    """Return pixels upright by an EXIF orientation, 1 to 8 (EXIF 2.3, tag 0x0112); anything else means 1."""
    if orientation in (5, 6, 7, 8):  # stored with rows and columns exchanged
        pixels = pixels.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels
