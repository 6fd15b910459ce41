"""How F is estimated, and which smears follow it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blur2view.arrays import Array
from blur2view.two_view.constants import INLIER_SHARE, INLIER_SIGMAS
from blur2view.two_view.ransac import RansacOptions

MOST_PX = 1e6  # beyond any photograph, and its square is a number


@dataclass(frozen=True, kw_only=True)
class EstimatorOptions:
    """How F is estimated.

    ``max_error_px``: see `tolerance_px` (the paper: 3 squared pixels). ``max_iterations`` samples at most and
    ``confidence``, see `ransac.RansacOptions`: 0.99 is enough, a sample yields many starts.
    """

    max_error_px: float = 3**0.5
    max_iterations: int = 1000
    confidence: float = 0.99

    def __post_init__(self) -> None:
        if not 0 < self.max_error_px <= MOST_PX:
            raise ValueError(f"max_error_px must be positive, at most {MOST_PX:g}, got {self.max_error_px}")
        self.search()

    def tolerance_px(self, length_px: Array, sigma_px: Array) -> Array:
        """Return the Sampson distances (N,), pixels, below which smears are inliers: the one definition.

        A tenth of the smear's length, at most ``max_error_px``, but two of its own standard deviations at
        least: a bound in pixels alone is as large as short smears are, and any F would fit them.
        """
        return np.maximum(np.minimum(INLIER_SHARE * length_px, self.max_error_px), INLIER_SIGMAS * sigma_px)

    def search(self) -> RansacOptions:
        """Return the options of the robust loop."""
        return RansacOptions(max_iterations=self.max_iterations, confidence=self.confidence)
