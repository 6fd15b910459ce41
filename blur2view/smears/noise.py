"""How wrong smears are: along and across themselves, with their neighbours, and all over the picture.

`NoiseModel` turns the standard deviations that are stated, by the network (`likelihood`, refined by
`networks.cepstral_peak`) or by a user, into those of the estimator of the camera's motion. Of its constants
`two_view.fundamental.DirectionLikelihood` uses `added_sampson` by itself; what tells moving objects apart
(`movers.moving`) adds errors of its own. Measured of the network that ships (`tools.datasets.testset
--kinds`: rotations, planes and general motions, seeds from 20000; smears of 8 px and more):

- stated deviations are root mean squares over all peaks of a likelihood and what cannot be seen; 68 and 50 %
  of the errors, along the smear and across it, are below 0.6 and 0.35 of them, and outliers are the rest.
  Errors follow the length more than what is stated: 68 and 50 % are below 6 and 4 % of it along the smear,
  below 4 and 2.5 % across;
- errors of windows of 96 px every 32 px are correlated: 0.7, 0.5, 0.35, 0.3 and 0.15 at a distance of 1, 2,
  3, 4 and 6 cells, which makes one cell in 46 independent, where overlap alone would make it one in 9;
- the mean error of a picture is 4 % of the lengths and 1 degree of the directions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from blur2view.arrays import Array

MIN_PX = 0.1  # standard deviation of a smear, at least
ADDED_SHARE = 0.01  # error across, as a share of the length, that is added in quadrature; along twice as much
CLAIMED = 0.65  # 68 % point of errors that are not outliers, over stated standard deviations: for covariances
WINDOW_PX = 96  # side of the window that a cell is read from, pixels
# How many times fewer cells are independent than their overlap says: the correlation reaches beyond it.
CORRELATED_CELLS = 46.0 / 9.0
# The Sampson distance of a smear over its error across, because each end is off by half of it; and back.
SAMPSON_SHARE: float = 0.5**0.5
ACROSS_SHARE: float = 2**0.5


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """How large the errors of smears are, and what those of one picture have in common.

    By default smears err independently, as matches of other programs do.
    """

    effective_share: float = 1.0  # share of the smears that err independently, by the overlap of windows
    correlation: float = 1.0  # by which that share is divided where all of the correlation counts
    # standard deviations of errors that vary slowly over the picture: of lengths, as a share, and directions
    length: float = 0.0
    direction_rad: float = 0.0
    # Error of the Sampson distance, as a share of the length, added in quadrature to the stated one.
    added_sampson: float = 0.01
    # Scale of Student's distribution of errors that are not outliers, over stated standard deviations; at
    # four degrees of freedom 0.85 is nearest to a normal distribution.
    inlier: float = 0.85
    # Error across, as a share of the length, added in quadrature to the stated one (twice it along): paths
    # are bent and cells cover more than a point.
    added_across: float = ADDED_SHARE
    # Odds of an outlier where parallax is judged; few of a network's are, as its inliers have heavy tails.
    outlier_odds: float = 0.5

    @classmethod
    def for_cells(cls, spacing_px: float, window_px: float = WINDOW_PX) -> NoiseModel:
        """Return the model of a network's cells every ``spacing_px``, read from windows of ``window_px``.

        The odds of an outlier were chosen on 25 rendered planes and rotations and 24 general motions (seeds
        from 20000 and 80000): parallax gains a log-likelihood of more than 7 in none and in 12 of them, with
        the default of 0.5 in none and in 8.
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
        """The same with all correlation counted and 68 % points as scale: for covariances, not for fits."""
        share = self.effective_share / self.correlation
        return replace(self, effective_share=share, correlation=1.0, inlier=CLAIMED, added_across=ADDED_SHARE)

    def inlier_sigmas_px(self, length_px: Array, sigma_px: Array, across: Array) -> Array:
        """Return the standard deviations (2, N) of inliers' errors along and across smears, pixels."""
        along = np.sqrt(np.maximum(sigma_px**2 - across**2, 0.0))
        added = self.added_across * np.stack([2 * length_px, length_px])
        return np.maximum(np.hypot(self.inlier * np.stack([along, across]), added), MIN_PX)

    def sampson_px(self, length_px: Array, across: Array) -> Array:
        """Return the standard deviations (N,) of the Sampson distances of smears, pixels."""
        return np.maximum(np.hypot(SAMPSON_SHARE * across, self.added_sampson * length_px), MIN_PX)


INDEPENDENT = NoiseModel()


def across_px(length_px: Array, sigma_rad: Array) -> Array:
    """Return the standard deviations (N,) of errors across smears, pixels: at least MIN_PX."""
    return np.maximum(length_px * sigma_rad, MIN_PX)
