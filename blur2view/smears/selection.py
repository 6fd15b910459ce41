"""Which smears of a field are used as matches: the certain ones, spread over the image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.smears.field import SmearField, smear_ends
from blur2view.smears.matches import LEAST_ACROSS_PX, STRIDE, SmearMatches

SURE_SHARE = 0.2  # standard deviation over length below which a smear is sure of itself
MOST_SURE = 2500  # places of the image where a sure smear may be taken
PLASTIC = 1.32471795724474602596  # the real root of x^3 = x + 1


@dataclass(frozen=True, kw_only=True)
class SelectOptions:
    """Which smears of a field become matches.

    ``beta`` the share of the stride-4 grid to keep (the paper: 0.35; 0.45 for driving); ``max_matches`` at
    most, spread over ``cells`` x ``cells`` parts of the image; ``min_length_px`` shorter smears have no
    direction worth the name; ``rank`` "relative" prefers small sigma over length, "absolute" small sigma
    (which favours short smears), "direction" sure directions (where the network has none, as
    "absolute"); ``sure_rad`` the sigma up to which a direction counts as known; ``still_sigma_px`` of a short
    smear up to which it shows that nothing moves there.
    """

    beta: float = 0.35
    max_matches: int = 2000
    min_length_px: float = 1.5
    cells: int = 16
    rank: Literal["direction", "relative", "absolute"] = "absolute"
    sure_rad: float = 0.35
    still_sigma_px: float = 3.0

    def __post_init__(self) -> None:
        """Refuse options out of range."""
        if not 0 < self.beta <= 1:
            raise ValueError(f"beta must be in (0, 1], got {self.beta}")
        if self.max_matches < 1 or self.cells < 1 or not 0 <= self.min_length_px < np.inf:
            raise ValueError(f"max_matches, cells must be positive, min_length_px not negative, got {self}")
        if self.rank not in ("direction", "relative", "absolute"):
            raise ValueError(f"rank must be 'direction', 'relative' or 'absolute', got {self.rank!r}")
        if not (self.sure_rad > 0 and self.still_sigma_px > 0):
            raise ValueError(f"sure_rad and still_sigma_px must be positive, got {self}")


def select_matches(field: SmearField, options: SelectOptions | None = None) -> SmearMatches:
    """Return the most certain smears of a field as matches, spread over the image; deterministic.

    Equally certain ones are taken from everywhere, not from the top of the image first.

    Parameters
    ----------
    field : SmearField
    options : SelectOptions, optional

    Returns
    -------
    SmearMatches
        Possibly empty (a sharp or constant image), all fields filled in that the network predicts.
    """
    options = options or SelectOptions()
    smears = GridSmears.of(field)
    length, sigma, sure_rad = smears.length_px, smears.sigma_px, smears.sigma_rad
    long = length >= options.min_length_px
    order = np.lexsort([scattered(smears.points), smears.quality(options.rank)])
    sure = order[long[order]][: int(np.ceil(options.beta * len(length)))]
    chosen = sure[spread(smears.points[sure], field.shape, options)]
    height, width = field.shape
    return SmearMatches(
        ends=smear_ends(smears.points[chosen], smears.displacement[chosen]),
        sigma_px=sigma[chosen],
        image_size=(width, height),
        still_share=_still_share(length, sigma, options),
        sure_share=1.0 if sure_rad is None else float((long & (sure_rad <= options.sure_rad)).mean()),
        across_px=None if smears.across_px is None else smears.across_px[chosen],
        sure_ends=sure_ends(field, options),
    )


def scattered(points: Array) -> Array:
    """Return a key (N,) in [0, 1) of grid points (N, 2): those below any value are spread evenly.

    References
    ----------
    Roberts, The unreasonable effectiveness of quasirandom sequences, 2018: the additive recurrence R2, whose
    constants are powers of the plastic number, as a dither of the plane.
    """
    key: Array = points // STRIDE @ PLASTIC ** -np.array([1.0, 2.0]) % 1
    return key


def sure_ends(field: SmearField, options: SelectOptions) -> Array:
    """Return the ends (M, 2, 2) of smears that are sure to SURE_SHARE of their length, evenly spread."""
    rows, cols = (np.unique(index) for index in grid_pixels(field.shape))
    step = int(np.ceil((len(rows) * len(cols) / MOST_SURE) ** 0.5))
    row, col = np.meshgrid(rows[step // 2 :: step], cols[step // 2 :: step], indexing="ij")
    smears = GridSmears.at(field, row.ravel(), col.ravel())
    length = smears.length_px
    sure = (length >= options.min_length_px) & (smears.sigma_px < SURE_SHARE * length)
    return smear_ends(smears.points[sure], smears.displacement[sure])


@dataclass(frozen=True, kw_only=True, eq=False)
class GridSmears:
    """The smears of a field at the centres of the network's cells, N.

    Parameters
    ----------
    points, displacement : ndarray of shape (N, 2)
        Pixels.
    sigma_px, sigma_rad : ndarray of shape (N,)
        Standard deviations; ``sigma_rad`` is None where the network does not predict it.
    """

    points: Array
    displacement: Array
    sigma_px: Array
    sigma_rad: Array | None

    @classmethod
    def of(cls, field: SmearField) -> GridSmears:
        """Return the smears of a field."""
        return cls.at(field, *grid_pixels(field.shape))

    @classmethod
    def at(cls, field: SmearField, rows: NDArray[np.int_], cols: NDArray[np.int_]) -> GridSmears:
        """Return the smears of a field at pixels (N,)."""
        return cls(
            points=np.stack([cols, rows], axis=1).astype(np.float64),
            displacement=field.displacement[rows, cols].astype(np.float64),
            sigma_px=np.maximum(field.sigma_px[rows, cols].astype(np.float64), 1e-3),
            sigma_rad=None if field.sigma_rad is None else field.sigma_rad[rows, cols].astype(np.float64),
        )

    @property
    def length_px(self) -> Array:
        """Lengths, (N,), pixels."""
        length: Array = np.hypot(*self.displacement.T)
        return length

    @property
    def across_px(self) -> Array | None:
        """Standard deviations of the error across the smear, (N,), pixels; None where unknown."""
        return None if self.sigma_rad is None else error_across(self.length_px, self.sigma_rad)

    def quality(self, rank: str) -> Array:
        """Return what the smears are ranked by, (N,); small is good."""
        if rank == "direction" and self.sigma_rad is not None:
            return self.sigma_rad
        if rank == "relative":
            return self.sigma_px / np.maximum(self.length_px, 1e-3)
        return self.sigma_px


def error_across(length_px: Array, sigma_rad: Array) -> Array:
    """Return the standard deviations (N,) of errors across smears, pixels, from lengths and directions."""
    return np.maximum(length_px * sigma_rad, LEAST_ACROSS_PX)


def grid_pixels(shape: tuple[int, int]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return rows and columns of the pixels [1::4, 1::4], nearest the centres of the cells; flat."""
    rows, cols = np.mgrid[min(1, shape[0] - 1) : shape[0] : STRIDE, min(1, shape[1] - 1) : shape[1] : STRIDE]
    return rows.ravel(), cols.ravel()


def spread(points: Array, shape: tuple[int, int], options: SelectOptions) -> NDArray[np.int_]:
    """Return indices of at most max_matches of the points (N, 2), best first, from each cell in turn."""
    size = np.array(shape[::-1], float)
    cell = (points / size * options.cells).astype(int) @ np.array([1, options.cells])
    order = np.argsort(cell, kind="stable")
    start = np.searchsorted(cell[order], cell[order])
    rank = np.empty(len(points), int)
    rank[order] = np.arange(len(points)) - start  # rank within the cell
    return np.argsort(rank, kind="stable")[: options.max_matches]


def _still_share(length: Array, sigma: Array, options: SelectOptions) -> float:
    """Return the share of the measurable smears (certain to half their length, or a sigma) that are short."""
    measurable: NDArray[Any] = sigma <= np.maximum(0.5 * length, options.still_sigma_px)
    still = measurable & (length < options.min_length_px)
    return float(still.sum() / max(measurable.sum(), 1))
