"""Ambiguous matches: the two ends of every smear without their order, of a grid's cells or any two views."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array, require
from blur2view.smears.grid import SmearGrid, smear_ends
from blur2view.smears.noise import INDEPENDENT, NoiseModel, across_px

MIN_MATCH_PX = 1.5  # length; the direction of shorter smears is noise
TINY_SIGMA_PX = 1e-3  # standard deviation of a smear, at least, so that none is 0


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearMatches:
    """Smears as matches whose order is unknown; ValueError for other shapes or values than stated here."""

    ends: Array  # (N, 2, 2), pixels; which of the two ends comes first is arbitrary
    sigma_px: Array  # (N,): standard deviations of the end-point errors |d - d*|; positive
    image_size: tuple[int, int] | None = None  # width, height; from it the estimator assumes a camera
    # (N,): standard deviations of the errors across the smears; by default errors are isotropic
    across_px: Array = None  # type: ignore[assignment]  # set below
    shared: NoiseModel = INDEPENDENT  # how large errors are, and what they have in common

    def __post_init__(self) -> None:
        ends, sigma = np.array(self.ends, np.float64), np.array(self.sigma_px, np.float64)
        across = 0.5**0.5 * sigma if self.across_px is None else np.array(self.across_px, np.float64)
        if ends.shape != (*sigma.shape, 2, 2) or sigma.ndim != 1 or across.shape != sigma.shape:
            got = f"{ends.shape}, {sigma.shape} and {across.shape}"
            raise ValueError(f"expected ends (N, 2, 2), sigma_px (N,) and across_px (N,), got {got}")
        if not (np.isfinite(ends).all() and np.isfinite([sigma, across]).all()):
            raise ValueError("ends, sigma_px and across_px must be finite")
        if not ((sigma > 0).all() and (across > 0).all() and min(self.image_size or (1,)) >= 1):
            raise ValueError("sigma_px, across_px and image_size must be positive")
        for name, array in (("ends", ends), ("sigma_px", sigma), ("across_px", across)):
            object.__setattr__(self, name, array)

    @classmethod
    def from_points(
        cls,
        points1: Array,
        points2: Array,
        sigma_px: float | Array = 1.0,
        image_size: tuple[int, int] | None = None,
    ) -> SmearMatches:
        """Return the matches of points (N, 2), pixels; ``sigma_px`` is twice a coordinate's deviation."""
        points1, points2 = np.asarray(points1, float), np.asarray(points2, float)
        if points1.shape != points2.shape or points1.ndim != 2 or points1.shape[1] != 2:
            raise ValueError(f"expected two arrays of shape (N, 2), got {points1.shape} and {points2.shape}")
        sigma = np.broadcast_to(np.asarray(sigma_px, float), points1.shape[:1])
        return cls(ends=np.stack([points1, points2], axis=1), sigma_px=sigma, image_size=image_size)

    def __len__(self) -> int:
        return len(self.ends)

    def subset(self, index: NDArray[Any] | slice) -> SmearMatches:
        """Return the matches of an index or mask."""
        ends, sigma, across = self.ends[index], self.sigma_px[index], self.across_px[index]
        return replace(self, ends=ends, sigma_px=sigma, across_px=across)

    @cached_property
    def midpoint(self) -> Array:
        """Mid-exposure pixels, (N, 2)."""
        return np.asarray(self.ends.mean(axis=1))

    @cached_property
    def displacement(self) -> Array:
        """Displacements d, (N, 2), pixels, sign arbitrary."""
        return self.ends[:, 1] - self.ends[:, 0]

    @cached_property
    def length_px(self) -> Array:
        """Lengths |d|, (N,), pixels."""
        return np.asarray(np.hypot(*self.displacement.T))

    @property
    def sampson_px(self) -> Array:
        """Standard deviations (N,) of the Sampson distances, pixels."""
        return self.shared.sampson_px(self.length_px, self.across_px)


@dataclass(frozen=True, kw_only=True)
class SelectOptions:
    """Which cells become matches.

    ``beta`` is the share of the cells to keep, the most certain ones (the paper: 0.35, 0.45 for driving;
    here every cell is weighed by its own uncertainty, so most of them help: the mean rho of 34 RedKitchen
    frames and 35 rendered scenes was 0.053 and 0.041 with half of the cells, 0.051 and 0.041 with nine
    tenths, 0.050 and 0.042 with all). In large photographs every n-th cell of a row and a column is taken, so
    that there are at most ``max_matches``.
    """

    beta: float = 0.9
    max_matches: int = 1000

    def __post_init__(self) -> None:
        if not 0 < self.beta <= 1:
            raise ValueError(f"beta must be in (0, 1], got {self.beta}")
        if self.max_matches < 1:
            raise ValueError(f"max_matches must be positive, got {self.max_matches}")


def select_matches(grid: SmearGrid, options: SelectOptions | None = None) -> SmearMatches:
    """Select cells of a grid as matches, possibly none (a sharp or constant image); deterministic.

    Parameters
    ----------
    grid : SmearGrid
        The smears of a photograph: ``estimate.grid``.
    options : SelectOptions, optional
        Which cells are selected.

    Returns
    -------
    SmearMatches
        The ends (N, 2, 2), pixels, of the selected cells' smears, with their standard deviations.

    Examples
    --------
    >>> import blur2view
    >>> grid = blur2view.estimate("models/sample.jpg", geometry=False).grid
    >>> matches = blur2view.select_matches(grid)
    >>> matches.ends.shape == (len(matches), 2, 2)
    True
    """
    require("grid", grid, SmearGrid, "as of network.predict(image)")
    options = options or SelectOptions()
    require("select", options, SelectOptions, "as SelectOptions(beta=0.5)")
    # every step-th cell of a row and of a column is taken, so that matches stay evenly spread
    step = max(1, int(np.ceil((options.beta * grid.cells[..., 0].size / options.max_matches) ** 0.5)))
    rows, columns = (slice(min(step, count) // 2, None, step) for count in grid.cells.shape[:2])
    points = grid.points()[rows, columns]
    points = points[(points < grid.size).all(axis=-1)]
    smears = grid.at(points)
    length = smears.length_px.astype(np.float64)
    sigma = np.maximum(smears.sigma_px.astype(np.float64), TINY_SIGMA_PX)
    order = np.argsort(sigma, kind="stable")
    count = min(int(np.ceil(options.beta * len(length))), options.max_matches)
    chosen = np.sort(order[(length >= MIN_MATCH_PX)[order]][:count])
    noise = INDEPENDENT
    if grid.window_px is not None:
        noise = NoiseModel.for_cells(step * grid.stride, grid.window_px)
    return SmearMatches(
        ends=smear_ends(points[chosen], smears.displacement[chosen]),
        sigma_px=sigma[chosen],
        image_size=grid.size,
        across_px=across_px(length, smears.sigma_rad.astype(np.float64))[chosen],
        shared=noise,
    )
