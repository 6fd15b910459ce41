"""The brightness of a photograph, made alike before anything is read: blur does not depend on it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray

Floats = NDArray[np.float32]

QUANTILE = 0.995
"""Of a photograph's values, that which says how bright it is: lamps and reflections are brighter."""
BRIGHT = 0.9
"""What it is brought to, if it is darker, for the shipped network."""
LARGEST_GAIN = 256.0
SAMPLES = 1_000_000
"""Values at least, where there are as many, that the quantile is taken of."""
EVERY, LOWER = 64, 0.98
"""One of as many values gives a lower quantile, about, so that the other is looked for among few."""


def gain_of(image: AnyArray, brightness: float = BRIGHT) -> float:
    """Return the factor, 1 at least, that makes a photograph (H, W, 3) or (H, W) so bright.

    Of uint8, uint16 or floats in [0, 1]. Its values are coded: the factor is that of the light to the power
    of the code's exponent, for whatever exponent.
    """
    every = max(int(np.sqrt(3 * image.shape[0] * image.shape[1] / SAMPLES)), 1)
    values = image[::every, ::every].reshape(-1)
    rank = min(int(QUANTILE * len(values)), len(values) - 1)
    if values.dtype == np.uint8:  # counted: a tenth of the time
        counts = cv2.calcHist([values], [0], None, [256], [0, 256])
        bright = int(np.searchsorted(np.cumsum(counts, dtype=np.int64), rank, side="right"))
    else:
        above, some = len(values) - rank, np.sort(values[::EVERY])
        upper = values[values >= some[int(LOWER * len(some))]]
        values = upper if above <= len(upper) else values
        bright = np.partition(values, len(values) - above)[len(values) - above]
    white = np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1
    return min(max(brightness / max(float(np.float32(bright) / np.float32(white)), 1e-6), 1.0), LARGEST_GAIN)


def brightened(image: Floats, gain: float) -> Floats:
    """Return a photograph, 0 to 1, brighter by a factor; the same array if it is 1."""
    return image if gain == 1 else np.minimum(image * np.float32(gain), np.float32(1))
