"""How wrong smears are: along and across themselves, with their neighbours, and all over the picture.

This is the only place that turns stated standard deviations, which `likelihood` reads off the network and
`networks.cepstral_peak` refines, or a user gives, into those that estimators use. Of the network that ships
(`tools.datasets.testset --kinds`: rotations, planes and general motions, seeds from 20000; 68 %
and 50 % points of the errors of smears of 8 px and more):

- stated deviations are root mean squares over all of a likelihood's peaks and what cannot be seen; the errors
  are 0.6 and 0.35 of them, along the smear and across it, and the rest is outliers. They follow the length
  more than what is stated: 6 and 4 % of it along, 4 and 2.5 % across;
- errors of windows of 96 px every 32 px are correlated: 0.7, 0.5, 0.35, 0.3 and 0.15 at 1, 2, 3, 4
  and 6 cells, which makes one cell in 46 independent, where overlap alone would make it one in 9;
- the mean error of a picture is 4 % of the lengths and 1 degree of the directions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from blur2view.arrays import Array

MIN_PX = 0.1  # standard deviation of a smear, at least
ADDED_SHARE = 0.01  # the same as a share of its length, across the smear; along it twice as much
CLAIMED = 0.65  # of the stated standard deviations, the 68 % points of what is no outlier: for regions
WINDOW_PX = 96  # side of the window that a cell is read from, pixels
# How many times fewer cells are independent than their overlap says: the correlation reaches beyond it.
CORRELATED_CELLS = 46.0 / 9.0
SAMPSON_SHARE = 0.5**0.5  # of the error across a smear, that of the Sampson distance of its two ends


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """How stated deviations are meant, and what errors of smears of one picture have in common.

    By default every smear errs for itself, as matches from elsewhere do.
    """

    effective_share: float = 1.0  # of the smears that err independently, by the overlap of their windows
    correlation: float = 1.0  # how many times fewer they are if all of the correlation counts
    # standard deviations of errors that vary slowly over the picture: of lengths, as a share, and directions
    length: float = 0.0
    direction_rad: float = 0.0
    added_sampson: float = 0.01  # share of its length to which no smear's Sampson distance is believed better
    # Of the stated standard deviations, the scale of Student's distribution of the errors which are no
    # outliers; 0.85 of four degrees of freedom is the nearest to a normal one.
    inlier: float = 0.85
    # Share of its length to which no smear's error across is believed better, and twice that to which none
    # along is: paths are bent and cells cover more than a point.
    added_across: float = ADDED_SHARE
    outlier_odds: float = 0.5  # for parallax to compete with: few of a network, whose errors have heavy tails

    @classmethod
    def of_cells(cls, spacing_px: float, window_px: float = WINDOW_PX) -> NoiseModel:
        """Return the model of a network's cells, read from windows, one every ``spacing_px`` pixels.

        Of 25 rendered planes and rotations and 24 general motions (seeds from 20000 and 80000) parallax gains
        more than 7 in none and in 12; at odds of a half, as of independent errors, in none and in 8.
        """
        return cls(
            effective_share=min(1.0, (spacing_px / window_px) ** 2),
            correlation=CORRELATED_CELLS,
            length=0.04,
            direction_rad=0.02,
            added_sampson=0.03,
            inlier=0.2,
            added_across=0.02,
            outlier_odds=0.01,
        )

    @property
    def fully_correlated(self) -> NoiseModel:
        """The same with every correlation counted, and 68 % points: for what is claimed, not for fits."""
        share = self.effective_share / self.correlation
        return replace(self, effective_share=share, correlation=1.0, inlier=CLAIMED, added_across=ADDED_SHARE)

    def inlier_sigmas_px(self, length_px: Array, sigma_px: Array, across: Array) -> Array:
        """Return standard deviations (2, N) along and across smears of inliers' errors, pixels."""
        along = np.sqrt(np.maximum(sigma_px**2 - across**2, 0.0))
        least = self.added_across * np.stack([2 * length_px, length_px])
        return np.maximum(np.hypot(self.inlier * np.stack([along, across]), least), MIN_PX)

    def sampson_px(self, length_px: Array, across: Array) -> Array:
        """Return standard deviations (N,) of the Sampson distances of smears, pixels, as stated."""
        return np.maximum(np.hypot(SAMPSON_SHARE * across, self.added_sampson * length_px), MIN_PX)


INDEPENDENT = NoiseModel()


def across_px(length_px: Array, sigma_rad: Array) -> Array:
    """Return deviations (N,) of errors across smears, pixels, of lengths (N,) and directions (N,)."""
    return np.maximum(length_px * sigma_rad, MIN_PX)
