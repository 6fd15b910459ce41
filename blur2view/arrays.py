"""Types and constants of arrays that every room shares."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TINY = 1e-30
