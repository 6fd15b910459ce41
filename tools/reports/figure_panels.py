"""Panels of photographs: smears beside their truth, epipolar lines on the sharp first and last frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.geometry.epipolar import homogeneous
from blur2view.geometry.sampson import sampson
from blur2view.visualization.overlay import farthest_points, spread_subset
from tools.evaluation.evaluate import true_ends
from tools.reports.figure_cases import Case, at_pixels, at_quantiles
from tools.reports.figure_style import PALETTE, new_figure, show_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure


QUANTILES = (0.1, 0.5, 0.9)
"""Of the images, from good to bad: those that panels show."""
SPACING_PX = 24
CLASSES_PX = (1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70)
"""Bounds of the classes of lengths and sigmas, one colour each."""
GREYS = 24
"""Shades of the photograph under what is drawn on it."""
SHORTEST_DRAWN_PX = 16
"""Median length below which smears are drawn longer than they are, and said to be."""
TITLES = ("input", "prediction, certain half", "truth where both ends are seen", "sigma")
POINTS = 7
"""Points whose epipolar lines are drawn, none in the outer eighth of the image."""


def smear_panels(found: Sequence[Case]) -> Figure:
    """Return input, certain half of the prediction, truth and sigma of a good, a middling and a bad image."""
    chosen = at_quantiles(found, lambda case: case.relative_error, QUANTILES)
    figure = new_figure(10, 2.05 * len(chosen) + 0.8)
    grid = figure.add_gridspec(len(chosen) + 1, 4, height_ratios=[1] * len(chosen) + [0.07])
    for k, (case, quantile) in enumerate(zip(chosen, QUANTILES, strict=True)):
        row = [figure.add_subplot(grid[k, column]) for column in range(4)]
        lengths, sigma = smear_row(row, case)
        error = f"EPE-S / length {case.relative_error:.2f}"
        row[0].set_ylabel(f"scene {case.scene.name}\n{error}\n({quantile:.0%} are better)")
        if k == 0:
            for axes, title in zip(row, TITLES, strict=True):
                axes.set_title(title)
    for drawn, place, label in (
        (lengths, grid[-1, 1:3], "true length of the smear, px"),
        (sigma, grid[-1, 3], "sigma, px"),
    ):
        bar = figure.colorbar(drawn, cax=figure.add_subplot(place), orientation="horizontal")
        bar.set_label(label)
    return figure


def smear_row(row: Sequence[Any], case: Case) -> tuple[Any, Any]:
    """Draw one image's four panels; return what the colour bars need."""
    image, scene = case.image, case.scene
    show_picture(row[0], image)
    draw_smears(row[1], image, scene.midpoints, case.displacement, case.sure)
    lengths = draw_smears(row[2], image, scene.midpoints, scene.displacement, scene.valid)
    show_picture(row[3], image)
    sigma = at_pixels(case.sigma_px, case.field.shape)
    drawn = row[3].imshow(sigma, norm=classes("cividis"), cmap="cividis", interpolation="nearest")
    return lengths, drawn


def classes(name: str) -> Any:
    """Return the norm that has one colour of a map for each class, and one beyond either end."""
    from matplotlib import colormaps
    from matplotlib.colors import BoundaryNorm

    return BoundaryNorm(CLASSES_PX, colormaps[name].N, extend="both")


def pale(image: AnyArray) -> AnyArray:
    """Return the photograph (H, W, 3) in GREYS pale shades (H, W), so that what is drawn on it stands out."""
    steps = GREYS - 1
    return np.asarray(0.5 + 0.45 * np.round(image.mean(axis=2) * steps) / steps)


def draw_smears(axes: Any, image: AnyArray, points: AnyArray, displacement: AnyArray, shown: AnyArray) -> Any:
    """Draw a spread of the smears of a grid over the paled photograph, white where none is to be shown."""
    from matplotlib.collections import LineCollection

    veiled = np.where(at_pixels(shown, image.shape[:2]) > 0.5, pale(image), 1.0)
    show_picture(axes, np.repeat(veiled[..., None], 3, axis=2))
    middle, d = points[shown], displacement[shown].astype(float)
    length = np.linalg.norm(d, axis=1)
    typical = float(np.median(length)) if len(length) else SPACING_PX
    stretch = max(1, round(SHORTEST_DRAWN_PX / max(typical, 1)))
    spacing = max(SPACING_PX, 0.6 * typical * stretch)
    kept = spread_subset(middle, -np.abs(middle % spacing - spacing / 2).max(axis=1), spacing)
    lines = LineCollection(
        list((middle[:, None] + stretch * np.stack([-d / 2, d / 2], axis=1))[kept]),
        array=length[kept],
        norm=classes("viridis_r"),
        cmap="viridis_r",
        linewidths=1.6,
    )
    if stretch > 1:
        axes.set_xlabel(f"drawn {stretch} times as long", labelpad=2, fontsize=7)
    axes.add_collection(lines)
    return lines


def epipolar_panels(found: Sequence[Case]) -> Figure:
    """Return points of the first sharp frame, and their epipolar lines on the last one, ours and the true."""
    chosen = at_quantiles(found, lambda case: case.rho, QUANTILES)
    figure = new_figure(8, 2.95 * len(chosen) + 0.4)
    rows = figure.subplots(len(chosen), 2, squeeze=False)
    for row, case, quantile in zip(rows, chosen, QUANTILES, strict=True):
        epipolar_row(row, case)
        row[0].set_ylabel(f"scene {case.scene.name}: {case.geometry.config.name}")
        row[1].set_xlabel(f"median rho {case.rho:.3f} ({quantile:.0%} of images are better)")
    rows[0][0].set_title("shutter-open: points")
    rows[0][1].set_title("shutter-close: the same points, lines of our F\n(dashed: of the true F)")
    return figure


def epipolar_row(row: Sequence[Any], case: Case) -> None:
    """Draw one image's two panels."""
    ends, F_true = true_ends(case.scene), case.scene.F
    assert F_true is not None and case.geometry.F is not None  # by the choice of cases
    F = in_true_time(case.geometry.F, ends)
    size = np.array(case.field.shape[::-1])
    inside = np.all((ends > size / 8) & (ends < 7 * size / 8), axis=(1, 2))
    ends = ends[inside] if inside.any() else ends
    ends = ends[farthest_points(ends.mean(axis=1), POINTS)]
    for axes, end, name in zip(row, (0, 1), ("open", "close"), strict=True):
        show_picture(axes, np.repeat(pale(case.sharp(name))[..., None], 3, axis=2))
        axes.scatter(
            *ends[:, end].T, s=42, c=PALETTE[: len(ends)], edgecolors="white", linewidths=1, zorder=4
        )
    for first, colour in zip(ends[:, 0], PALETTE, strict=False):
        draw_line(row[1], F @ homogeneous(first), color=colour, lw=1.6)
        draw_line(row[1], F_true @ homogeneous(first), color=colour, lw=1.2, ls=(0, (4, 3)), alpha=0.9)


def in_true_time(F: AnyArray, ends: AnyArray) -> AnyArray:
    """Return F or its transpose, whichever fits ends (N, 2, 2) in true order: one photograph cannot tell."""
    forward, backward = (np.median(sampson(f, ends[:, 0], ends[:, 1])) for f in (F, F.T))
    return F if forward <= backward else np.asarray(F.T)


def draw_line(axes: Any, line: AnyArray, **drawn: Any) -> None:
    """Draw the line (3,) over the whole picture, its limits kept."""
    normal = np.hypot(line[0], line[1])
    if not normal > 0:
        return
    foot = -line[2] / normal**2 * line[:2]
    axes.axline(foot, foot + np.array([-line[1], line[0]]) / normal, **drawn)
