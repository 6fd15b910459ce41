"""The brightness of a photograph, made alike before anything is read: blur does not depend on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

QUANTILE = 0.995
"""Of a photograph's values, that which says how bright it is: lamps and reflections are brighter."""
BRIGHT = 0.9
"""What it is brought to, if it is darker, for the shipped network."""
LARGEST_GAIN = 256.0
SAMPLES = 1_000_000
"""Values at least, where there are as many, that the quantile is taken of."""


def gain_of(image: Floats, brightness: float = BRIGHT) -> float:
    """Return the factor, 1 at least, that makes a photograph (H, W, 3) or (H, W), 0 to 1, so bright.

    Its values are coded: the factor is that of the light to the power of the code's exponent, for whatever
    exponent.
    """
    every = max(int(np.sqrt(image.size / SAMPLES)), 1)
    values = image[::every, ::every].ravel()
    rank = min(int(QUANTILE * len(values)), len(values) - 1)
    bright = float(np.partition(values, rank)[rank])
    return min(max(brightness / max(bright, 1e-6), 1.0), LARGEST_GAIN)


def brightened(image: Floats, brightness: float) -> Floats:
    """Return a photograph, 0 to 1, so bright; the same array where it is as bright already."""
    gain = gain_of(image, brightness)
    return image if gain == 1 else np.minimum(image * np.float32(gain), np.float32(1))
