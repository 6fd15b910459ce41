"""How F is estimated and when it is trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blur2view.arrays import Array
from blur2view.robust.ransac import RansacOptions

MOST = 1e6  # pixels, or standard deviations: beyond any photograph, and its square is a number


@dataclass(frozen=True, kw_only=True)
class EstimatorOptions:
    """How F is estimated and when it is trusted.

    Errors: ``max_error_px`` a match with SErrMin below its square is an inlier (the paper: 3 squared
    pixels), as is one within ``cutoff`` of its own standard deviations; ``relative_sigma`` and
    ``min_sigma_px`` the least standard deviation of a Sampson distance, as a share of the smear's length
    and in pixels. Search: see `ransac.RansacOptions`; ``fit_error_px`` is the paper's threshold for its stop
    on ``stop_inlier_share``; ``confidence`` 0.99 is enough: a sample yields many starts.
    Trust: ``min_matches``; ``min_length_px`` the least median smear; ``min_sure_share`` of the image in which
    blur has a direction; ``max_still_share`` of the measurable image; ``min_coverage`` the least share of the
    image's square blocks with matches, ``coverage_blocks`` of which lie along its longer side;
    ``min_agreement`` the least share of smears that agree with F beyond chance, ``sure_agreement`` the share
    that needs no second test, ``min_held_out`` the least share of one half of the image that the other half
    predicts.
    """

    max_error_px: float = 3**0.5
    cutoff: float = 3.0
    relative_sigma: float = 0.03
    min_sigma_px: float = 0.1
    coverage_blocks: int = 24
    max_iterations: int = 1000
    confidence: float = 0.99
    stop_inlier_share: float = 0.9
    fit_error_px: float = 1.0
    min_matches: int = 30
    min_length_px: float = 1.0
    min_sure_share: float = 0.02
    max_still_share: float = 0.6
    min_coverage: float = 0.08
    min_agreement: float = 0.2
    sure_agreement: float = 0.8
    min_held_out: float = 0.06

    def __post_init__(self) -> None:
        """Refuse options out of range."""
        for name in ("max_error_px", "cutoff", "min_sigma_px", "fit_error_px"):
            if not 0 < getattr(self, name) <= MOST:
                raise ValueError(f"{name} must be positive, at most {MOST:g}, got {getattr(self, name)}")
        for name in ("relative_sigma", "min_length_px"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be finite and not negative, got {getattr(self, name)}")
        if self.min_matches < 8:
            raise ValueError(f"min_matches must be at least 8, got {self.min_matches}")
        if self.coverage_blocks < 1:
            raise ValueError(f"coverage_blocks must be at least 1, got {self.coverage_blocks}")
        shares = ("min_sure_share", "max_still_share", "min_coverage")
        for name in (*shares, "min_agreement", "sure_agreement", "min_held_out"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be in [0, 1], got {getattr(self, name)}")
        self.search()

    def tolerance_px(self, sigma_px: Array) -> Array:
        """Return the Sampson distances (N,), pixels, below which smears of these sigma are inliers."""
        return np.maximum(self.cutoff * sigma_px, self.max_error_px)

    def search(self) -> RansacOptions:
        """Return the options of the robust loop."""
        return RansacOptions(
            max_iterations=self.max_iterations, confidence=self.confidence, stop_share=self.stop_inlier_share
        )
