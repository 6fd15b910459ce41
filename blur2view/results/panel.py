"""The panel below the overlay: the verdict in plain words, the key of the colours, a map of uncertainty."""

import numpy as np

from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.results.drawing import (
    FAINT,
    LEADING_PX,
    PAPER,
    TEXT_SIZE,
    Picture,
    draw_line,
    heat_colours,
    orientation_colours,
    wrap,
    write,
)
from blur2view.results.verdicts import sentence
from blur2view.smears.grid import SmearGrid
from blur2view.smears.matches import SmearMatches

_AIDS_HEIGHT_PX = 132
HEAD_SIZE, HEAD_LEADING_PX = 0.55, 22  # of the verdict


def draw_panel(
    width: int,
    grid: SmearGrid,
    matches: SmearMatches,
    geometry: TwoViewGeometry,
    exposure_s: float | None = None,
) -> Picture:
    """Return the panel: the caption on the left, the orientation key and the uncertainties on the right."""
    aids = np.hstack([_orientation_key(), _sigma_inset(grid)])
    room = width - aids.shape[1] - 24
    verdict = wrap(sentence(geometry, matches, grid.size, exposure_s), room, HEAD_SIZE)
    small = wrap(f"{_counts(matches, geometry)} (COLMAP: {geometry.config.name})", room, TEXT_SIZE)
    height = max(aids.shape[0], 20 + HEAD_LEADING_PX * len(verdict) + LEADING_PX * len(small))
    panel = np.full((height, width, 3), PAPER, np.uint8)
    panel[: aids.shape[0], width - aids.shape[1] :] = aids
    for index, line in enumerate(verdict):
        write(panel, line, (10, 24 + HEAD_LEADING_PX * index), size=HEAD_SIZE)
    top = 24 + HEAD_LEADING_PX * len(verdict)
    for index, line in enumerate(small):
        write(panel, line, (10, top + LEADING_PX * index), colour=FAINT)
    return panel


def _counts(matches: SmearMatches, geometry: TwoViewGeometry) -> str:
    """Return how many smears were used and how long they are."""
    if len(matches) == 0:
        return "no smears used"
    length = f"median length {np.median(matches.length_px):.1f} px"
    if geometry.F is None:
        return f"{len(matches)} smears used, {length}"
    fit = f"{np.count_nonzero(geometry.inlier_mask)} of {len(matches)} smears fit F"
    if geometry.H is not None:
        return f"{fit}, but H explains them, too; {length}"
    lines = "white: epipolar lines, where F lets the ends of smears lie"
    return f"{fit}, {length}; {lines}; ring: the epipole, to or from which the camera moved"


def _orientation_key() -> Picture:
    """Return a wheel whose spokes have the colour of their orientation."""
    key = np.full((_AIDS_HEIGHT_PX, 96, 3), PAPER, np.uint8)
    angles = np.radians(np.arange(0, 180, 3))
    spokes = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    centre = np.array([47.5, 70.0])
    for spoke, colour in zip(spokes, orientation_colours(spokes), strict=True):
        for side in (-1, 1):
            draw_line(key, centre + side * np.outer([16, 42], spoke), colour, thickness=2)
    write(key, "orientation", (12, 16), colour=FAINT)
    return key


def _sigma_inset(grid: SmearGrid) -> Picture:
    """Return a map of sigma on a logarithmic scale, with the scale's ends in pixels of the photograph."""
    height, width = grid.shape
    scale = min(150 / width, (_AIDS_HEIGHT_PX - 34) / height)
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    x, y = ((np.arange(count) + 0.5) / scale - 0.5 for count in size)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    small = grid.at(points).sigma_px.reshape(size[::-1])
    logs = np.log10(np.maximum(small, 1e-3))
    low, high = np.percentile(logs, [2, 98])
    high = max(high, low + 0.1)  # a constant map has one colour
    inset = np.full((_AIDS_HEIGHT_PX, 150 + 62, 3), PAPER, np.uint8)
    left = 150 - size[0]
    inset[24 : 24 + size[1], left:150] = heat_colours((logs - low) / (high - low))
    bar_height = _AIDS_HEIGHT_PX - 34
    inset[24 : 24 + bar_height, 158:168] = heat_colours(
        np.linspace(1, 0, bar_height)[:, None].repeat(10, axis=1)
    )
    write(inset, "uncertainty, px", (0, 16), colour=FAINT)
    write(inset, short_number(10**high), (174, 35))
    write(inset, short_number(10**low), (174, 24 + bar_height))
    return inset


def short_number(value: float) -> str:
    """Return a positive number with two digits, without an exponent up to 9999, so that it fits the scale."""
    return f"{value:.0f}" if 9.5 <= value < 9999.5 else f"{value:.2g}"
