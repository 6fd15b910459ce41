"""Types and constants of arrays that every room shares."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]
AnyArray = NDArray[Any]
"""Of any dtype: pictures, masks, float32 maps."""
TINY = 1e-30


def white_level(image: AnyArray) -> int:
    """Return the value of white in a picture of integers, or of floats in [0, 1]."""
    return int(np.iinfo(image.dtype).max) if np.issubdtype(image.dtype, np.integer) else 1


def ranked(values: AnyArray, ranks: Sequence[int]) -> AnyArray:
    """Return the values, of an array of any shape, that have these ranks; the least has rank 0."""
    if values.dtype != np.uint8:
        return np.asarray(np.partition(values, ranks, axis=None)[list(ranks)])
    counts = cv2.calcHist([values.reshape(1, -1)], [0], None, [256], [0, 256])  # a tenth of the time
    return np.searchsorted(np.cumsum(counts, dtype=float), ranks, side="right").astype(np.uint8)


def require(name: str, value: object, kind: type, remedy: str) -> None:
    """Raise ValueError, with a remedy, unless the argument of this name is an instance of a class."""
    if not isinstance(value, kind):
        got = f"{type(value).__name__} {value!r:.99}"
        raise ValueError(f"{name} must be a blur2view.{kind.__name__}, {remedy}, got {got}")
