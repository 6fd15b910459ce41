"""Rolling shutters: all rows of a photograph are exposed equally long, one begins after the other.

A point is seen while its row is open. Its smear D leads from the row on which it is when that row opens to
the row on which it is when that one closes, which opened r D_y later (r the time from row to row): it is seen
for e + r D_y, e the exposure time. So D / (1 + r D_y / e) is its smear in e, exactly at a constant velocity,
and -D / (1 - r D_y / e) if the photograph was taken in the other order in time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blur2view.smears.matches import SmearMatches

MAX_READOUT_S = 1.0  # no electronic shutter is as slow
LONG_S = 2.0  # an exposure beyond is taken for milliseconds
MIN_EXPOSURES = 0.1  # of an exposure; points that keep up with the rows would be seen for less
AROUND = 16  # smears that decide the order of one: without parallax the order of some is open


@dataclass(frozen=True, kw_only=True)
class RollingShutter:
    """A shutter that exposes one row after the other; ValueError of times that no shutter has."""

    readout_s: float  # from the start of the first row's exposure to that of the last
    exposure_s: float  # of each row
    towards: tuple[int, int] = (0, 1)  # rows begin from top to bottom; (1, 0): from left to right; or against

    def __post_init__(self) -> None:
        if not 0 <= self.readout_s <= MAX_READOUT_S:
            raise ValueError(f"readout must be between 0 and {MAX_READOUT_S:g} s, got {self.readout_s}")
        if not 0 < self.exposure_s < np.inf:
            raise ValueError(f"exposure must be positive and finite, got {self.exposure_s}")
        if self.towards not in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            raise ValueError(f"towards must be (0, 1), (0, -1), (1, 0) or (-1, 0), got {self.towards}")

    def all_rows_at_once(
        self, matches: SmearMatches, second_end_is_open: NDArray[np.bool_], image_size: tuple[int, int]
    ) -> SmearMatches | None:
        """Return the matches of a global shutter, given where (N,) second ends are open; None without any."""
        from scipy.spatial import cKDTree  # 0.1 s, so only for a rolling shutter

        directed = np.where(second_end_is_open, -1.0, 1.0)[:, None] * matches.displacement
        around = cKDTree(matches.midpoint).query(matches.midpoint, min(AROUND, len(matches)))[1]
        backward = (matches.displacement * directed[around].sum(axis=1)).sum(axis=1) < 0
        rows = max(int(np.abs(self.towards) @ image_size) - 1, 1)
        later = np.where(backward, -1.0, 1.0) * (matches.displacement @ np.array(self.towards)) / rows
        exposures = 1 + self.readout_s / self.exposure_s * later  # for how many exposure times each was seen
        if np.median(exposures) <= MIN_EXPOSURES:
            return None
        exposures = np.maximum(exposures, MIN_EXPOSURES)
        middle = matches.midpoint[:, None]
        return replace(
            matches,
            ends=middle + (matches.ends - middle) / exposures[:, None, None],
            sigma_px=matches.sigma_px / exposures,
            across_px=matches.across_px / exposures,
        )
