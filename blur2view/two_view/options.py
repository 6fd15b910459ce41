"""How F is estimated, and which smears follow it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blur2view.arrays import Array
from blur2view.two_view.constants import INLIER_SHARE, INLIER_SIGMAS

MOST_PX = 1e6  # beyond any photograph, and its square is a number


@dataclass(frozen=True, kw_only=True)
class EstimatorOptions:
    """How F is estimated.

    Parameters
    ----------
    max_error_px : float
        Largest distance of an inlier from its epipolar line, see `tolerance_px` (the paper: 3 squared
        pixels).

    Raises
    ------
    ValueError
        If it is not positive or beyond any photograph.
    """

    max_error_px: float = 3**0.5

    def __post_init__(self) -> None:
        if not 0 < self.max_error_px <= MOST_PX:
            raise ValueError(f"max_error_px must be positive, at most {MOST_PX:g}, got {self.max_error_px}")

    def tolerance_px(self, length_px: Array, sigma_px: Array) -> Array:
        """Return the Sampson distances (N,), pixels, below which smears are inliers: the one definition.

        A tenth of the smear's length, at most ``max_error_px``, but two of its own standard deviations at
        least: a bound in pixels alone is as large as short smears are, and any F would fit them.
        """
        return np.maximum(np.minimum(INLIER_SHARE * length_px, self.max_error_px), INLIER_SIGMAS * sigma_px)
