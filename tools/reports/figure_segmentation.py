"""Panels of motion masks: photograph, what moves by itself, our mask and the probability behind it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.pipeline import Estimate, Timings
from blur2view.segmentation.mask import MotionLabel, MotionMask, segment
from blur2view.visualization.mask_overlay import PINK
from tools.evaluation.segmentation import overlap
from tools.reports.figure_cases import Case, at_pixels, at_quantiles
from tools.reports.figure_panels import QUANTILES, pale
from tools.reports.figure_style import new_figure, show_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure


LEAST_SHARE = 0.03
"""Of the image that must move by itself for a scene to be shown."""
TITLES = ("input", "truth: pink moves, dark is hidden", "mask: dark is unobservable", "probability of moving")


def masked(case: Case) -> MotionMask:
    """Return the motion mask of one photograph."""
    found = Estimate(
        field=case.field,
        matches=case.matches,
        geometry=case.geometry,
        model_id="",
        timings=Timings(predict_s=0.0, select_s=0.0, solve_s=0.0),
    )
    return segment(found)


def mask_iou(case: Case, mask: MotionMask) -> float:
    """Return the IoU of "moving" over cells with a truth that the mask calls observable; 0 if none."""
    labels = mask.labels[1::4, 1::4]
    known = case.scene.valid & (labels != MotionLabel.UNOBSERVABLE)
    mine, true = (labels == MotionLabel.MOVING) & known, ~case.scene.static & known
    return float(np.nan_to_num(overlap(mine, true)))


def painted(image: AnyArray, moving: AnyArray, unseen: AnyArray) -> AnyArray:
    """Return masks (H, W) over the paled photograph (H, W, 3): pink what moves, dark what is not seen."""
    picture = np.repeat(pale(image)[..., None], 3, axis=2)
    picture[unseen] *= 0.35
    picture[moving] = 0.35 * picture[moving] + 0.65 * np.array(PINK) / 255
    return picture


def segmentation_panels(found: Sequence[Case]) -> Figure | None:
    """Return a good, a middling and a bad mask, by their IoU, of scenes in which something moves by itself.

    None where nothing does.
    """
    movers = [c for c in found if (~c.scene.static & c.scene.valid).mean() >= LEAST_SHARE]
    if not movers:
        return None
    masks = {id(case): masked(case) for case in movers}
    chosen = at_quantiles(movers, lambda case: -mask_iou(case, masks[id(case)]), QUANTILES)
    figure = new_figure(10, 2.05 * len(chosen) + 0.8)
    grid = figure.add_gridspec(len(chosen) + 1, 4, height_ratios=[1] * len(chosen) + [0.07])
    for k, (case, quantile) in enumerate(zip(chosen, QUANTILES, strict=True)):
        row = [figure.add_subplot(grid[k, column]) for column in range(4)]
        scale = mask_row(row, case, masks[id(case)])
        iou = f"IoU {mask_iou(case, masks[id(case)]):.2f}"
        row[0].set_ylabel(f"scene {case.scene.name}\n{iou}\n({quantile:.0%} are better)")
        if k == 0:
            for axes, title in zip(row, TITLES, strict=True):
                axes.set_title(title)
    bar = figure.colorbar(scale, cax=figure.add_subplot(grid[-1, 3]), orientation="horizontal")
    bar.set_label("probability")
    return figure


def mask_row(row: Sequence[Any], case: Case, mask: MotionMask) -> Any:
    """Draw one image's four panels; return what the colour bar needs."""
    image, shape = case.image, case.field.shape
    hidden = at_pixels(~case.scene.valid, shape) > 0.5
    moves = at_pixels(~case.scene.static, shape) > 0.5
    show_picture(row[0], image)
    show_picture(row[1], painted(image, moves & ~hidden, hidden))
    mine, unseen = (mask.labels == label for label in (MotionLabel.MOVING, MotionLabel.UNOBSERVABLE))
    show_picture(row[2], painted(image, mine, unseen))
    show_picture(row[3], image)
    steps = np.round(mask.probability * 16) / 16
    return row[3].imshow(steps, vmin=0, vmax=1, cmap="cividis", interpolation="nearest")
