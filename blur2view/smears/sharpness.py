"""How far a photograph is smeared, in one length and one direction, and how sharp that makes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blur2view.smears.field import to_double_angle
from blur2view.smears.grid import SmearGrid

UNSEEN_PX = 500.0  # sigma of what shows no texture at all, which a network gives 1000, or borders on it
LEAST_SEEN = 0.05  # share of a photograph that must show texture


@dataclass(frozen=True, kw_only=True)
class MedianSmear:
    """The smear of a photograph as a whole.

    Parameters
    ----------
    length_px : float
        Median length of the smears, pixels.
    direction_deg : float
        Of the mean smear (in double angle, where opposite smears are one), 0 to 180 degrees, from the x axis
        towards y, which points down.
    sigma_px : float
        Median of the standard deviations of the lengths, pixels: a smear shorter than that may be none.
    """

    length_px: float
    direction_deg: float
    sigma_px: float

    @property
    def sharpness(self) -> float:
        """Return the sharpness of this length."""
        return sharpness(self.length_px)


def median_smear(grid: SmearGrid) -> MedianSmear | None:
    """Return the smear of a photograph as a whole; None if hardly any of it shows texture.

    The plain median over all that shows texture, the truest to the name: its rank correlation with that of
    the true smears is 0.91 on the test split (``python -m tools.benchmarks.triage``).
    """
    smears = grid.smears()
    seen = smears.sigma_px < UNSEEN_PX
    if seen.mean() < LEAST_SEEN:
        return None
    x, y = to_double_angle(smears.displacement[seen]).mean(axis=0)
    return MedianSmear(
        length_px=float(np.median(smears.length_px[seen])),
        direction_deg=float(np.degrees(np.arctan2(y, x)) / 2 % 180),
        sigma_px=float(np.median(smears.sigma_px[seen])),
    )


def sharpness(smear_px: float) -> float:
    """Return 1 / (1 + smear length in pixels): 1 without any, 0.5 at one pixel, always above 0."""
    return 1 / (1 + smear_px)
