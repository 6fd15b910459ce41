"""Rolling shutters: all rows of a photograph are exposed for the same time, each begins after the one above.

A point is recorded while the row on which it lies is exposed. Its smear D begins on a row when that row
opens, and ends on another when that one closes, which opened r D_y later, r the time from row to row: the
point is recorded for e + r D_y, e the exposure time. At a constant velocity its smear in e is therefore
exactly D / (1 + r D_y / e), and -D / (1 - r D_y / e) if the other end came first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blur2view.smears.matches import SmearMatches

MAX_READOUT_S = 1.0  # bound: no electronic shutter is as slow
MIN_EXPOSURES = 0.1  # exposure times for which a point is recorded, at least: bound
AROUND = 16  # nearest smears that decide the order of each, as without parallax some orders are undecided


@dataclass(frozen=True, kw_only=True)
class RollingShutter:
    """A shutter that exposes one row after the other; ValueError if no shutter has such times."""

    readout_s: float  # from the start of the first row's exposure to that of the last
    exposure_s: float  # of each row
    towards: tuple[int, int] = (0, 1)  # (x, y) from the first row to the last: (0, 1) is from top to bottom

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
        """Return the smears that an exposure of all rows at once would leave.

        ``second_end_is_open`` (N,) is their order. None if, in this order, half of the points would outrun
        the rows.
        """
        from scipy.spatial import cKDTree  # slow to import, and needed only for a rolling shutter

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
