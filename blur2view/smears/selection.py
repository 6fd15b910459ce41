"""The cells of a smear grid as matches: each that says something, the least certain tenth left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blur2view.arrays import require
from blur2view.smears.field import smear_ends
from blur2view.smears.grid import SmearGrid
from blur2view.smears.matches import SmearMatches
from blur2view.smears.noise import across_px

SHORTEST_PX = 1.5
"""Shorter smears have no direction worth the name."""
LEAST_SIGMA_PX = 1e-3


@dataclass(frozen=True, kw_only=True)
class SelectOptions:
    """Which cells become matches.

    ``beta`` is the share of the cells to keep, the most certain ones (the paper: 0.35, 0.45 for driving;
    here every cell is weighed by its own uncertainty, so most of them help: of 34 RedKitchen frames and 35
    rendered scenes the mean rho was 0.053 and 0.041 with half of them, 0.051 and 0.041 with nine tenths,
    0.050 and 0.042 with all). Of large photographs every second or third cell of a row and a column is taken,
    so that there are at most ``max_matches``.
    """

    beta: float = 0.9
    max_matches: int = 1000

    def __post_init__(self) -> None:
        if not 0 < self.beta <= 1:
            raise ValueError(f"beta must be in (0, 1], got {self.beta}")
        if self.max_matches < 1:
            raise ValueError(f"max_matches must be positive, got {self.max_matches}")


def select_matches(grid: SmearGrid, options: SelectOptions | None = None) -> SmearMatches:
    """Return cells of a grid as matches, possibly none (a sharp or constant image); deterministic."""
    require("grid", grid, SmearGrid, "as of network.predict(image)")
    options = options or SelectOptions()
    require("select", options, SelectOptions, "as SelectOptions(beta=0.5)")
    step = cells_apart(grid, options)
    rows, columns = (slice(min(step, count) // 2, None, step) for count in grid.cells.shape[:2])
    points = grid.points()[rows, columns]
    inside = (points < grid.size).all(axis=-1)
    points, smears = points[inside], grid.at(points[inside])
    length = smears.length_px.astype(np.float64)
    sigma = np.maximum(smears.sigma_px.astype(np.float64), LEAST_SIGMA_PX)
    long = length >= SHORTEST_PX
    order = np.argsort(sigma, kind="stable")
    most = min(int(np.ceil(options.beta * len(length))), options.max_matches)
    kept = np.sort(order[long[order]][:most])
    return SmearMatches(
        ends=smear_ends(points[kept], smears.displacement[kept]),
        sigma_px=sigma[kept],
        image_size=grid.size,
        across_px=across_px(length, smears.sigma_rad.astype(np.float64))[kept],
        shared=grid.shared_errors(step * grid.stride),
    )


def cells_apart(grid: SmearGrid, options: SelectOptions) -> int:
    """Return how many cells lie from one match to the next in a row or column: 1 if all may be matches."""
    return max(1, int(np.ceil((options.beta * grid.cells[..., 0].size / options.max_matches) ** 0.5)))
