"""Ambiguous matches: the two ends of every smear, without their order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from blur2view.smear import SmearField, smear_ends

Array = NDArray[np.float64]
LEAST_ACROSS_PX = 0.1
STRIDE = 4  # the network's grid: cell (i, j) has its centre at pixel (4j + 1.5, 4i + 1.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearMatches:
    """Smears as matches whose order is unknown.

    Parameters
    ----------
    ends : ndarray of shape (N, 2, 2), float64
        The two ends of every smear, pixels; which of them is the start means nothing.
    sigma_px : ndarray of shape (N,), float64
        Standard deviation of the end-point error |d - d*| of every smear; positive.
    image_size : (int, int), optional
        Width and height of the image. With it the estimator may assume an ordinary camera.
    still_share : float
        Share of the measurable image that shows no motion, in [0, 1].
    sure_share : float
        Share of the image in which the direction of blur can be told, in [0, 1].
    across_px : ndarray of shape (N,), float64, optional
        Standard deviation of the part of the error across every smear, where the network tells; positive.

    Raises
    ------
    ValueError
        If shapes or values are not as above.
    """

    ends: Array
    sigma_px: Array
    image_size: tuple[int, int] | None = None
    still_share: float = 0.0
    sure_share: float = 1.0
    across_px: Array | None = None

    def __post_init__(self) -> None:
        """Convert to float64 and check shapes and values."""
        ends, sigma = np.array(self.ends, np.float64), np.array(self.sigma_px, np.float64)
        if ends.ndim != 3 or ends.shape[1:] != (2, 2) or sigma.shape != ends.shape[:1]:
            raise ValueError(f"expected ends (N, 2, 2) and sigma_px (N,), got {ends.shape} and {sigma.shape}")
        if not (np.isfinite(ends).all() and np.isfinite(sigma).all() and (sigma > 0).all()):
            raise ValueError("ends must be finite, sigma_px finite and positive")
        if self.image_size is not None and min(self.image_size) < 1:
            raise ValueError(f"image_size must be positive, got {self.image_size}")
        for name in ("still_share", "sure_share"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be in [0, 1], got {getattr(self, name)}")
        if self.across_px is not None:
            across = np.array(self.across_px, np.float64)
            if across.shape != sigma.shape or not (np.isfinite(across).all() and (across > 0).all()):
                raise ValueError(f"across_px must be finite and positive, of shape {sigma.shape}")
            object.__setattr__(self, "across_px", across)
        object.__setattr__(self, "ends", ends)
        object.__setattr__(self, "sigma_px", sigma)

    @classmethod
    def from_points(
        cls,
        points1: Array,
        points2: Array,
        sigma_px: float | Array = 1.0,
        image_size: tuple[int, int] | None = None,
    ) -> SmearMatches:
        """Build from two arrays (N, 2) of matched pixels; what their order was is forgotten.

        ``sigma_px`` is that of the displacement, a number or (N,): twice the standard deviation of one
        coordinate of one point, if both points err alike.
        """
        points1, points2 = np.asarray(points1, float), np.asarray(points2, float)
        if points1.shape != points2.shape or points1.ndim != 2 or points1.shape[1] != 2:
            raise ValueError(f"expected two arrays of shape (N, 2), got {points1.shape} and {points2.shape}")
        sigma = np.broadcast_to(np.asarray(sigma_px, float), points1.shape[:1])
        return cls(ends=np.stack([points1, points2], axis=1), sigma_px=sigma, image_size=image_size)

    def __len__(self) -> int:
        """Give the number of matches."""
        return len(self.ends)

    def subset(self, index: NDArray[Any]) -> SmearMatches:
        """Only the matches of an index or mask."""
        across_px = None if self.across_px is None else self.across_px[index]
        return replace(self, ends=self.ends[index], sigma_px=self.sigma_px[index], across_px=across_px)

    @property
    def across_scale(self) -> float:
        """Median of the whole error's sigma over that across the smear; 1 where the latter is not known."""
        if self.across_px is None or not len(self):
            return 1.0
        return float(np.median(self.sigma_px / self.across_px))

    def weighed_across(self) -> SmearMatches:
        """Return the matches with sigmas in proportion to the errors across the smears, if these are known.

        Their size stays that of the whole error in the median, so that what is believed of smears does not
        depend on whether the network tells directions.
        """
        if self.across_px is None or not len(self):
            return self
        return replace(self, sigma_px=self.across_px * self.across_scale)

    @property
    def midpoint(self) -> Array:
        """Mid-exposure pixels, (N, 2)."""
        middle: Array = self.ends.mean(axis=1)
        return middle

    @property
    def displacement(self) -> Array:
        """Displacements d, (N, 2), pixels, sign arbitrary."""
        displacement: Array = self.ends[:, 1] - self.ends[:, 0]
        return displacement

    @property
    def length_px(self) -> Array:
        """Lengths |d|, (N,), pixels."""
        length: Array = np.hypot(*self.displacement.T)
        return length


@dataclass(frozen=True, kw_only=True)
class SelectOptions:
    """Which smears of a field become matches.

    ``beta`` the share of the stride-4 grid to keep (the paper: 0.35; 0.45 for driving); ``max_matches`` at
    most, spread over ``cells`` x ``cells`` parts of the image; ``min_length_px`` shorter smears have no
    direction worth the name; ``rank`` "relative" prefers small sigma over length, "absolute" small sigma
    (which favours short smears), "direction" sure directions (where the network does not tell, as
    "absolute"); ``sure_rad`` the sigma up to which a direction can be told; ``still_sigma_px`` of a short
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
    """Turn the surest smears of a field into matches, spread over the image; deterministic.

    Parameters
    ----------
    field : SmearField
    options : SelectOptions, optional

    Returns
    -------
    SmearMatches
        Possibly empty (a sharp or constant image), all fields filled in that the network tells.
    """
    options = options or SelectOptions()
    smears = GridSmears.of(field)
    length, sigma, sure_rad = smears.length_px, smears.sigma_px, smears.sigma_rad
    long = length >= options.min_length_px
    candidates = np.flatnonzero(long)
    order = np.argsort(smears.quality(options.rank)[candidates], kind="stable")
    sure = candidates[order][: int(np.ceil(options.beta * len(length)))]
    chosen = sure[spread(smears.points[sure], field.shape, options)]
    height, width = field.shape
    return SmearMatches(
        ends=smear_ends(smears.points[chosen], smears.displacement[chosen]),
        sigma_px=sigma[chosen],
        image_size=(width, height),
        still_share=_still_share(length, sigma, options),
        sure_share=1.0 if sure_rad is None else float((long & (sure_rad <= options.sure_rad)).mean()),
        across_px=None if smears.across_px is None else smears.across_px[chosen],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class GridSmears:
    """The smears of a field at the centres of the network's cells, N.

    Parameters
    ----------
    points, displacement : ndarray of shape (N, 2)
        Pixels.
    sigma_px, sigma_rad : ndarray of shape (N,)
        Standard deviations; ``sigma_rad`` is None where the network does not tell.
    """

    points: Array
    displacement: Array
    sigma_px: Array
    sigma_rad: Array | None

    @classmethod
    def of(cls, field: SmearField) -> GridSmears:
        """Sample a field."""
        return cls.at(field, *grid_pixels(field.shape))

    @classmethod
    def at(cls, field: SmearField, rows: NDArray[np.int_], cols: NDArray[np.int_]) -> GridSmears:
        """Sample a field at pixels (N,)."""
        told = field.sigma_rad
        return cls(
            points=np.stack([cols, rows], axis=1).astype(np.float64),
            displacement=field.displacement[rows, cols].astype(np.float64),
            sigma_px=np.maximum(field.sigma_px[rows, cols].astype(np.float64), 1e-3),
            sigma_rad=None if told is None else told[rows, cols].astype(np.float64),
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
    """Give the standard deviations (N,) of errors across smears, pixels, from lengths and directions."""
    return np.maximum(length_px * sigma_rad, LEAST_ACROSS_PX)


def grid_pixels(shape: tuple[int, int]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Rows and columns of the pixels [1::4, 1::4], nearest the centres of the network's cells; flat."""
    rows, cols = np.mgrid[min(1, shape[0] - 1) : shape[0] : STRIDE, min(1, shape[1] - 1) : shape[1] : STRIDE]
    return rows.ravel(), cols.ravel()


def spread(points: Array, shape: tuple[int, int], options: SelectOptions) -> NDArray[np.int_]:
    """Choose at most max_matches of the points (N, 2), best first, taking turns between the cells.

    Returns
    -------
    ndarray of int, shape (at most max_matches,)
        Indices in order of rank within their cell.
    """
    size = np.array(shape[::-1], float)
    cell = (points / size * options.cells).astype(int) @ np.array([1, options.cells])
    order = np.argsort(cell, kind="stable")
    start = np.searchsorted(cell[order], cell[order])
    turn = np.empty(len(points), int)
    turn[order] = np.arange(len(points)) - start  # rank within the cell
    chosen: NDArray[np.int_] = np.argsort(turn, kind="stable")[: options.max_matches]
    return chosen


def _still_share(length: Array, sigma: Array, options: SelectOptions) -> float:
    """Share of the measurable smears (sure to half their length, or to still_sigma_px) that are too short."""
    measurable: NDArray[Any] = sigma <= np.maximum(0.5 * length, options.still_sigma_px)
    still = measurable & (length < options.min_length_px)
    return float(still.sum() / max(measurable.sum(), 1))
