"""How wrong smears are: along and across themselves, with their neighbours, and all over the picture.

This is the only place that turns the standard deviations a network states, or a user gives, into those that
estimators use. Measured on smears of the network in 36 rendered photographs with parallax, rotation or a
plane (development seeds 30000 to 30011 of `tools.datasets.motion_kinds`):

- stated deviations are root mean squares over all of a likelihood's peaks; the bulk of the errors is smaller,
  0.6 times along the smear and 0.65 across it (68 % points), and the rest is outliers;
- errors of windows of 96 px every 32 px are correlated: 0.7, 0.5, 0.35, 0.3 and 0.15 at 1, 2, 3, 4
  and 6 cells, which makes one cell in 46 independent, where overlap alone would make it one in 9;
- the mean error of a picture is 4 % of the lengths and 1 degree of the directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blur2view.arrays import Array

BULK_ALONG, BULK_ACROSS = 0.6, 0.65
"""Of the stated standard deviation, that of the errors which are no outliers."""
LEAST_ALONG, LEAST_ACROSS = 0.02, 0.01
"""Of the length: no smear is believed better, for paths are bent and cells cover more than a point."""
LEAST_PX = 0.1
LENGTH_ERROR = 0.1
"""Of the length, the deviation along a smear beyond that across it, where it is compared with lines."""
WINDOW_PX = 96
"""Side of the window that a cell is read from, pixels."""
CORRELATED_CELLS = 46.0 / 9.0
"""How many times fewer cells are independent than their overlap says: the correlation reaches beyond it."""
SAMPSON_SHARE = 0.5**0.5
"""Of the error across a smear, that of the Sampson distance of its two ends, which share it."""


@dataclass(frozen=True, kw_only=True)
class SharedErrors:
    """What errors of smears of one picture have in common.

    ``independent_share`` is the share of the smears that err independently of each other, by the overlap of
    what they were read from; ``reach`` how many times fewer they are if all of the correlation counts;
    ``length`` and ``direction_rad`` the standard deviations of errors that vary slowly over the whole
    picture, of lengths as a share, of directions in radians; ``least`` the share of its length to which no
    smear's Sampson distance is believed better.
    """

    independent_share: float = 1.0
    reach: float = 1.0
    length: float = 0.0
    direction_rad: float = 0.0
    least: float = 0.01

    def __post_init__(self) -> None:
        if not (
            0 < self.independent_share <= 1 <= self.reach
            and min(self.length, self.direction_rad, self.least) >= 0
        ):
            raise ValueError(f"expected a share in (0, 1] and standard deviations, got {self}")

    @property
    def all_correlation(self) -> float:
        """Share of independent smears if every correlation counts: for what is claimed, not for fits."""
        return self.independent_share / self.reach

    @classmethod
    def of_cells(cls, spacing_px: float, window_px: float = WINDOW_PX) -> SharedErrors:
        """Return those of a network's cells, read from windows, one every ``spacing_px`` pixels."""
        share = min(1.0, (spacing_px / window_px) ** 2)
        return cls(
            independent_share=share, reach=CORRELATED_CELLS, length=0.04, direction_rad=0.02, least=0.03
        )


INDEPENDENT = SharedErrors()
"""Every smear errs for itself: matches from elsewhere."""


def across_px(length_px: Array, sigma_rad: Array) -> Array:
    """Return standard deviations of errors across smears, pixels, from lengths and those of directions."""
    return np.maximum(length_px * sigma_rad, LEAST_PX)


def bulk_px(length_px: Array, sigma_px: Array, across: Array) -> tuple[Array, Array]:
    """Return standard deviations (N,) of errors along and across smears that are no outliers, pixels.

    Of the stated deviation of the whole end-point error ``sigma_px`` and of its part across the smear.
    """
    along = np.sqrt(np.maximum(sigma_px**2 - across**2, 0.0))
    pair = (BULK_ALONG * along, LEAST_ALONG), (BULK_ACROSS * across, LEAST_ACROSS)
    first, second = (np.maximum(np.hypot(sigma, least * length_px), LEAST_PX) for sigma, least in pair)
    return first, second


def sampson_px(length_px: Array, across: Array, shared: SharedErrors) -> Array:
    """Return standard deviations (N,) of the Sampson distances of smears, pixels, as stated."""
    return np.maximum(np.hypot(SAMPSON_SHARE * across, shared.least * length_px), LEAST_PX)
