"""How F is estimated and when it is trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blur2view.arrays import Array
from blur2view.robust.ransac import RansacOptions
from blur2view.robust.residuals import CUTOFF

MOST_PX = 1e6  # beyond any photograph, and its square is a number


@dataclass(frozen=True, kw_only=True)
class EstimatorOptions:
    """How F is estimated.

    ``max_error_px``: a match with SErrMin below its square is an inlier (the paper: 3 squared pixels), as is
    one within CUTOFF of its own standard deviations. ``max_iterations`` samples at most and ``confidence``,
    see `ransac.RansacOptions`: 0.99 is enough, a sample yields many starts.
    """

    max_error_px: float = 3**0.5
    max_iterations: int = 1000
    confidence: float = 0.99

    def __post_init__(self) -> None:
        if not 0 < self.max_error_px <= MOST_PX:
            raise ValueError(f"max_error_px must be positive, at most {MOST_PX:g}, got {self.max_error_px}")
        self.search()

    def tolerance_px(self, sigma_px: Array) -> Array:
        """Return the Sampson distances (N,), pixels, below which smears of these sigma are inliers."""
        return np.maximum(CUTOFF * sigma_px, self.max_error_px)

    def search(self) -> RansacOptions:
        """Return the options of the robust loop."""
        return RansacOptions(max_iterations=self.max_iterations, confidence=self.confidence)
