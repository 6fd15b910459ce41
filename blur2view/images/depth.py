"""The value of white in files of more than 8 bits: that of the bits, unless the values have only 8."""

import os
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.files import read_regular
from blur2view.output import is_ours

OTHERS = 8  # files of a folder that are looked at: bound
MIN_BRIGHTEST = (
    128  # of the files of a folder, if they fill 8 bits: darker ones may be dark ones of 16 (bound)
)


def in_least_bits(image: AnyArray, path: Path | None = None) -> AnyArray:
    """Return integers (H, W) or (H, W, C) of a file as uint8 if their values have 8 bits, as uint16 if not.

    Where a program stores 8 bits in 16 without scaling them, no colour is above 255, and the brightest is not
    far below. So it may be in a dark frame of 16 bits, too: the brightest of it and of other files of 16 bits
    in the folder of the ``path`` decides. ValueError of values whose white no file states.
    """
    low, high = int(image.min()), int(image.max())
    if low < 0 or high > 65535:
        raise ValueError(f"its values go from {low} to {high}, so that its white is unknown")
    brightest = int(image[..., :3].max()) if image.ndim == 3 else high
    if brightest <= 255 and path is not None:
        brightest = max(brightest, brightest_beside(path))
    if not MIN_BRIGHTEST <= brightest <= 255:
        return image.astype(np.uint16, copy=False)
    if high > 255:  # of alpha alone
        image = np.concatenate([image[..., :3], image[..., 3:] // 257], axis=-1)
    return image.astype(np.uint8)


def brightest_beside(path: Path) -> int:
    """Return the highest colour of files of this suffix and 16 bits in the same folder, as far as is looked.

    0 of a folder that cannot be listed, or is on another machine.
    """
    folder, suffix = path.parent, path.suffix.lower()
    try:
        return _brightest(folder, suffix, os.stat(folder).st_mtime_ns) if suffix else 0
    except OSError:
        return 0


@lru_cache(maxsize=64)
def _brightest(folder: Path, suffix: str, changed_ns: int) -> int:
    """Return the answer for a folder as it was changed last: each of its files asks."""
    paths = [folder / name for name in sorted(os.listdir(folder)) if name.lower().endswith(suffix)]
    every = max(-(-len(paths) // OTHERS), 1)
    return max(map(_highest, paths[::every]), default=0)


def _highest(path: Path) -> int:
    """Return the highest colour of a file of 16 bits, 0 of any other, of damage, and of results."""
    try:
        content = np.frombuffer(b"" if is_ours(path) else read_regular(path), np.uint8)
        pixels = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if len(content) else None
    except (OSError, cv2.error, MemoryError):
        return 0
    if pixels is None or pixels.dtype == np.uint8:
        return 0
    return int(pixels[..., :3].max() if pixels.ndim == 3 else pixels.max())
