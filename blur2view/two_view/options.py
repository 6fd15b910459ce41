"""How F is estimated and when it is trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blur2view.arrays import Array
from blur2view.robust.ransac import RansacOptions

MOST_PX = 1e6  # beyond any photograph, and its square is a number
CUTOFF = 3.0
"""Residual, in standard deviations, at which a smear is as likely an outlier as an inlier."""


@dataclass(frozen=True, kw_only=True)
class EstimatorOptions:
    """How F is estimated.

    ``max_error_px``: a match with SErrMin below its square is an inlier (the paper: 3 squared pixels), as is
    one within CUTOFF of its own standard deviations. ``max_iterations`` samples at most and ``confidence``,
    see `ransac.RansacOptions`: 0.99 is enough, a sample yields many starts; ``stop_inlier_share`` of the
    smears within ``fit_error_px`` ends the search (the paper: 0.9 within 1).
    """

    max_error_px: float = 3**0.5
    max_iterations: int = 1000
    confidence: float = 0.99
    stop_inlier_share: float = 0.9
    fit_error_px: float = 1.0

    def __post_init__(self) -> None:
        """Refuse options out of range."""
        for name in ("max_error_px", "fit_error_px"):
            if not 0 < getattr(self, name) <= MOST_PX:
                raise ValueError(f"{name} must be positive, at most {MOST_PX:g}, got {getattr(self, name)}")
        self.search()

    def tolerance_px(self, sigma_px: Array) -> Array:
        """Return the Sampson distances (N,), pixels, below which smears of these sigma are inliers."""
        return np.maximum(CUTOFF * sigma_px, self.max_error_px)

    def search(self) -> RansacOptions:
        """Return the options of the robust loop."""
        return RansacOptions(
            max_iterations=self.max_iterations, confidence=self.confidence, stop_share=self.stop_inlier_share
        )
