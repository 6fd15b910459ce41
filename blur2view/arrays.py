"""Types and constants of arrays that every room shares."""

from typing import Any

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


def require(name: str, value: object, kind: type, remedy: str) -> None:
    """Raise ValueError, with a remedy, unless the argument of this name is an instance of a class."""
    if not isinstance(value, kind):
        got = f"{type(value).__name__} {value!r:.99}"
        raise ValueError(f"{name} must be a blur2view.{kind.__name__}, {remedy}, got {got}")
