"""Photographs as arrays: checked, scaled to floats in [0, 1], and brightened."""

import math
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from blur2view.arrays import AnyArray, Array, Floats, ranked, white_level
from blur2view.files import MAX_PIXELS
from blur2view.images.depth import in_least_bits

BACKDROP = np.float32(0.5)
"""Grey behind transparent pixels: its edges against an unknown photograph are the weakest."""
QUANTILE, BRIGHT, MAX_GAIN = 0.995, 0.9, 256.0
"""Quantile of a photograph's values that is brought to this brightness, and the largest factor; bounds."""
STRIP_PIXELS = 1 << 18
"""Pixels that are copied from Pillow at a time: of 1 << 14 to 20 the fastest."""
MIN_SAMPLES = 1_000_000
"""Values, of a larger photograph, that the quantile is taken of; bound."""
GRADIENT_SIDE_PX = 480
"""Longer side of the copies whose gradients are compared: among neighbours in four videos they chose better
than those of 640, 960 and 1280 px, which show more noise."""
LEVELS_OF_8_BITS = np.arange(256, dtype=np.float32) / np.float32(255)
MIN_SIDE_PX, MAX_ASPECT = 16, 100
"""Shortest side, and longest over shortest: smaller ones show no smear, strips no field of them; bounds."""
TOO_LARGE = f"resize it to at most {MAX_PIXELS // 1_000_000} megapixels"
EXPECTED = "expected a photograph (H, W, 3) RGB or (H, W) grey, of uint8, uint16 or floats in [0, 1]"


def as_photograph(image: AnyArray | Image.Image, path: Path | None = None) -> AnyArray:
    """Check a photograph and return it as an array (H, W, 3) or (H, W) with the bits it has.

    It is RGB (OpenCV's BGR as ``image[..., ::-1]``) or grey: (H, W), (H, W, 1), (H, W, 3), (H, W, 4) with
    alpha, which is composited over mid-grey; uint8, uint16 or floats in [0, 1]; or a picture of Pillow, whose
    other files in the folder of its ``path`` help to tell its white (`in_least_bits`). ValueError of
    anything else.
    """
    if isinstance(image, Image.Image):
        mode = "RGBA" if image.has_transparency_data else "L" if image.mode in ("1", "L") else "RGB"
        deep = image.mode.startswith("I")  # 16 bits in either order of bytes, those of PGM in 32 bits
        image = _array_of(image, None if deep or image.mode in (mode, "F") else mode)
        image = in_least_bits(image, path) if deep else image
    if not isinstance(image, np.ndarray):
        raise ValueError(f"{EXPECTED}, as from read_image(path), got {image!r:.99}")
    if not image.dtype.isnative:
        image = image.astype(image.dtype.newbyteorder("="))
    integer = image.dtype in (np.uint8, np.uint16)
    has_shape = image.shape[2:] in ((), (1,), (3,), (4,)) and image.ndim > 1 and image.size
    if not has_shape or not (integer or np.issubdtype(image.dtype, np.floating)):
        raise ValueError(f"{EXPECTED}, got {image.dtype} {image.shape}")
    if not (integer or (image.min() >= 0 and image.max() <= 1)):  # NaN if any value is
        raise ValueError(f"expected finite values in [0, 1], got {image.min():.4g} to {image.max():.4g}")
    if image.shape[2:] == (4,):
        image = over_backdrop(as_floats(image))
    if not integer:
        image = np.asarray(image, np.float32)
    grey = image.shape[2:] == (1,) or (image.ndim == 3 and image.strides[2] == 0)  # or of equal channels
    return image[..., 0] if grey else image


def _array_of(picture: Image.Image, mode: str | None) -> AnyArray:
    """Return the pixels of a picture, converted to a mode if one is named.

    Strips are converted and copied: all at once Pillow needs the memory twice more, and twice the time.
    """
    width, height = picture.size
    rows = max(STRIP_PIXELS // width, 1)
    array: AnyArray | None = None
    for top in range(0, height, rows):
        strip = picture.crop((0, top, width, min(top + rows, height)))
        pixels = np.asarray(strip if mode is None else strip.convert(mode))
        array = np.empty((height, *pixels.shape[1:]), pixels.dtype) if array is None else array
        array[top : top + rows] = pixels
    assert array is not None
    return array


def unusable_size(width: int, height: int) -> str:
    """Return why a photograph of this size cannot be used, and what can; "" if it can."""
    shorter, longer = sorted((width, height))
    if shorter < MIN_SIDE_PX:
        return f"use the original photograph, at least {MIN_SIDE_PX}x{MIN_SIDE_PX}"
    if longer > MAX_ASPECT * shorter:
        return f"cut it so that no side is more than {MAX_ASPECT} times the other"
    return "" if width * height <= MAX_PIXELS else TOO_LARGE


def as_rgb(image: AnyArray | Image.Image) -> Floats:
    """Return a photograph, as `as_photograph` takes it, as contiguous RGB (H, W, 3), float32 in [0, 1]."""
    return as_floats(as_photograph(image))


def as_floats(image: AnyArray, gain: float = 1.0) -> Floats:
    """Scale pixels (H, W, C) or (H, W) of `as_photograph` to [0, 1], brightened; (H, W) becomes (H, W, 3)."""
    if image.dtype == np.uint8:  # a table takes a third of the time
        table = brightened(LEVELS_OF_8_BITS, gain)
        values = np.asarray(cv2.LUT(np.ascontiguousarray(image), table), np.float32)
    else:
        values = np.ascontiguousarray(image, np.float32)
        if image.dtype == np.uint16:
            values = values / np.float32(65535)
        values = brightened(values, gain)
    return values if values.ndim == 3 else np.repeat(values[..., None], 3, axis=2)


def upright_from_stored(stored: AnyArray, orientation: int) -> AnyArray:
    """Turn pixels (H, W, ...), as they are stored, upright: the inverse of `stored_from_upright`."""
    return stored_from_upright(stored, {6: 8, 8: 6}.get(orientation, orientation))


def stored_from_upright(upright: AnyArray, orientation: int) -> AnyArray:
    """Turn upright pixels or labels (H, W, ...) to how they are stored, by EXIF 2.3's tag 0x0112, 1 to 8."""
    if orientation in (3, 4, 7, 8):
        upright = upright[::-1]
    if orientation in (2, 3, 6, 7):
        upright = upright[:, ::-1]
    return upright.swapaxes(0, 1) if orientation in (5, 6, 7, 8) else upright


def to_resized(points: Array, scale: float) -> Array:
    """Return pixels (..., 2) as those of a picture ``scale`` times as large; the corners coincide."""
    return (points + 0.5) * scale - 0.5


def from_resized(points: Array, scale: float) -> Array:
    """Return pixels (..., 2) of a picture that was made ``scale`` times as large as those of the original."""
    return (points + 0.5) / scale - 0.5


def over_backdrop(values: Floats) -> Floats:
    """Composite pixels (H, W, C + 1) in [0, 1], of which the last is alpha, over mid-grey: (H, W, C)."""
    return np.asarray(BACKDROP + (values[..., :-1] - BACKDROP) * values[..., -1:], np.float32)


def brightness_gain(image: AnyArray, brightness: float = BRIGHT, samples: int = MIN_SAMPLES) -> float:
    """Return the factor, from 1 to `MAX_GAIN`, that brings a photograph's bright values to a brightness."""
    every = max(int(np.sqrt(3 * image.shape[0] * image.shape[1] / samples)), 1)
    values = image[::every, ::every]
    rank = min(int(QUANTILE * values.size), values.size - 1)
    bright = float(np.float32(ranked(values, [rank])[0]) / np.float32(white_level(image)))
    return min(max(brightness / max(bright, 1e-6), 1.0), MAX_GAIN)


def gradient_energy(picture: AnyArray) -> float:
    """Return the energy of gradients of a picture (H, W, 3), RGB, or (H, W), uint8, reduced.

    It is the geometric mean of the mean squared gradients along the two principal directions: motion weakens
    those along its path alone, whichever that is, and in their sum (Tenengrad) the others hide it. Among
    pictures of the same things the sharpest has the most. The determinant of the matrix of gradients is that
    of C. Harris and M. Stephens, A combined corner and edge detector, 1988.
    """
    grey = picture if picture.ndim == 2 else np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
    if (larger := max(grey.shape) / GRADIENT_SIDE_PX) > 1:
        size = [max(round(side / larger), 1) for side in grey.shape[::-1]]
        grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA))
    x, y = cv2.spatialGradient(grey)  # by Sobel, whose weights have the sum 8
    xx, yy, sums = (cv2.norm(one, cv2.NORM_L2SQR) for one in (x, y, cv2.add(x, y)))
    xy = (sums - xx - yy) / 2
    return math.sqrt(max(xx * yy - xy**2, 0.0)) / 64 / grey.size


def brightened(image: Floats, gain: float) -> Floats:
    """Multiply a photograph in [0, 1] by a factor and clip it at 1; the same array if the factor is 1."""
    return image if gain == 1 else np.minimum(image * np.float32(gain), np.float32(1))
