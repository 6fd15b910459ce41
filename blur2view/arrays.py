"""Types and constants of arrays that every room shares."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
AnyArray = NDArray[Any]
"""Of any dtype: pictures, masks, float32 maps."""
TINY = 1e-30
