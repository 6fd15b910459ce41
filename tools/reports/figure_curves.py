"""Curves over the whole test split: what sigma is worth, and how far true smears lie from the lines of F."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.camera.image import read_image
from blur2view.geometry.sampson import serrmin
from blur2view.metrics import PAPER_INLIER, cumulative_curve, epe_s, sparsification_curve
from blur2view.two_view.search import two_parameter_fundamental
from tools.estimators import baselines
from tools.evaluation.evaluate import true_ends
from tools.evaluation.smear_figures import coherence, evaluate_smears, pooled
from tools.evaluation.smear_plot import draw_sparsification
from tools.reports.figure_cases import Case
from tools.reports.figure_style import BLACK, BLUE, GREEN, ORANGE, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SERRMIN_PX2 = np.geomspace(1e-3, 1e3, 121)
"""Bounds at which cumulative curves are drawn."""


def ours(case: Case) -> AnyArray | None:
    """Return the F of the pipeline."""
    return case.geometry.F


def two_parameters(case: Case) -> AnyArray | None:
    """Return the F whose smears all meet in one point."""
    return two_parameter_fundamental(case.matches)


def unordered(case: Case) -> AnyArray | None:
    """Return OpenCV's F of the same ends in random order."""
    ends = baselines.scrambled(case.matches.ends, np.random.default_rng(0))
    return baselines.solve(baselines.opencv_magsac, ends)


def true(case: Case) -> AnyArray | None:
    """Return the true F."""
    return case.scene.F


SOURCES: dict[str, tuple[Callable[[Case], AnyArray | None], str, str]] = {
    "ours": (ours, BLUE, "-"),
    "two-parameter F": (two_parameters, ORANGE, "-"),
    "unordered ends, OpenCV MAGSAC": (unordered, GREEN, "-"),
    "true F": (true, BLACK, "--"),
}
"""Where F is from: function, colour, line."""


def sparsification(found: Sequence[Case]) -> Figure:
    """Return sparsification curves: of all smears together, and of each image's, averaged over the images."""
    smears, images = pooled((case.scene, case.field) for case in found)
    figure = new_figure(9, 3.8)
    together, each = figure.subplots(1, 2, sharey=True)
    draw_sparsification(together, smears, evaluate_smears(smears, images))
    together.set(title=f"All smears of {images} images together", xlabel="share of smears removed")
    each.set(title="Each image by itself, mean over images", xlabel="share of smears removed")
    curves = np.mean([image_curves(case) for case in found], axis=0)
    removed, by_coherence, by_sigma, by_error = curves
    for name, curve in (("local coherence", by_coherence), ("sigma", by_sigma)):
        area = float((curve - by_error).mean())
        each.plot(removed, curve, label=f"{name}, area {area:.2f}")
    each.plot(removed, by_error, "k--", lw=1, label="the error itself (oracle)")
    each.legend()
    each.set_ylim(0, None)
    return figure


def image_curves(case: Case) -> AnyArray:
    """Return shares removed and curves (4, steps) of one image: by coherence, by sigma, by the error."""
    valid = case.scene.valid
    error = epe_s(case.displacement[valid], case.scene.displacement[valid])
    classical = coherence(read_image(case.scene.image_path))[valid]
    removed, by_sigma, by_error = sparsification_curve(error, case.sigma_px[valid])
    return np.stack([removed, sparsification_curve(error, -classical)[1], by_sigma, by_error])


def cumulative(found: Sequence[Case]) -> Figure:
    """Return cumulative SErrMin curves, means over the images whose camera translates.

    Left on true smears, where the true F has no error; right on the matches that every estimator was given.
    """
    moving = [case for case in found if case.scene.F is not None]
    figure = new_figure(9, 3.8)
    panels = figure.subplots(1, 2, sharey=True)
    for name, (source, colour, line) in SOURCES.items():
        matrices = [source(case) for case in moving]
        for panel, ends_of in zip(panels, (static_ends, matched_ends), strict=True):
            curve = mean_curve(matrices, [ends_of(case) for case in moving])
            share = float(np.interp(np.log(PAPER_INLIER), np.log(SERRMIN_PX2), curve))
            panel.plot(SERRMIN_PX2, curve, line, color=colour, label=f"{name}: {share:.0%} below 3")
    panels[0].set(title=f"True smears of static pixels, {len(moving)} images", ylabel="share of smears")
    panels[1].set(title="The network's smears that were used")
    for panel in panels:
        decorate(panel)
    return figure


def static_ends(case: Case) -> AnyArray:
    """Return the ends (N, 2, 2) of the true smears of static pixels."""
    return true_ends(case.scene)


def matched_ends(case: Case) -> AnyArray:
    """Return the ends (N, 2, 2) of the smears that were used."""
    return case.matches.ends


def mean_curve(matrices: Sequence[AnyArray | None], ends: Sequence[AnyArray]) -> AnyArray:
    """Return the average of the images' cumulative curves; no F explains no smear."""
    curves = [
        np.zeros(len(SERRMIN_PX2)) if F is None else cumulative_curve(serrmin(F, pairs), SERRMIN_PX2)
        for F, pairs in zip(matrices, ends, strict=True)
    ]
    return np.asarray(np.mean(curves, axis=0))


def decorate(panel: Any) -> None:
    """Mark the paper's bound of an inlier, label the axis."""
    panel.axvline(PAPER_INLIER, color="0.5", lw=1, ls=":")
    panel.set(
        xscale="log", ylim=(0, 1.02), xlim=SERRMIN_PX2[[0, -1]], xlabel="SErrMin, px$^2$ (dotted: 3 px$^2$)"
    )
    panel.legend(loc="lower right")
