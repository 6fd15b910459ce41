"""The picture of the smears' figures: what sigma is worth, and lengths by octave."""

import io
from pathlib import Path
from typing import Any

from PIL import Image

from tools.evaluation.smear_figures import SmearFigures, Smears
from tools.metrics import epe_s, sparsification_curve

COLOURS = 96


def plot(smears: Smears, figures: SmearFigures, path: Path) -> None:
    """Draw sigma against error, the sparsification curves and the lengths by octave; write a PNG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 4), layout="constrained")
    calibration, sparsification, lengths = figure.subplots(1, 3)
    draw_calibration(calibration, figures)
    draw_sparsification(sparsification, smears, figures)
    draw_lengths(lengths, figures)
    save(figure, path)


def save(figure: Any, path: Path) -> None:
    """Write a PNG of few colours, which plots need; the same figure gives the same bytes."""
    raw = io.BytesIO()
    figure.savefig(raw, dpi=100, format="png", facecolor="white", metadata={"Software": None})
    with Image.open(raw) as picture:
        flat = picture.convert("RGB").quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    path.parent.mkdir(parents=True, exist_ok=True)
    flat.save(path, "PNG", optimize=True)


def draw_calibration(axes: Any, figures: SmearFigures) -> None:
    """Root mean square error against sigma, by tenths of sigma; the diagonal is a calibrated one."""
    sigma, error = [b.sigma_px for b in figures.bins], [b.error_px for b in figures.bins]
    span = [min(sigma + error), max(sigma + error)]
    axes.loglog(span, span, "k--", lw=1, label="calibrated")
    axes.loglog(sigma, error, "o-", label="a tenth of the smears each")
    axes.set(xlabel="sigma, px", ylabel="root mean square EPE-S, px", title="What sigma says and what is")
    axes.legend()


def draw_sparsification(axes: Any, smears: Smears, figures: SmearFigures) -> None:
    """Mean error of what is left against the share removed: by sigma, by the error."""
    error = epe_s(smears.found, smears.true)
    removed, by_sigma, by_error = sparsification_curve(error, smears.sigma)
    axes.plot(removed, by_sigma, label=f"sigma, area {figures.sparsification_area:.2f}")
    axes.plot(removed, by_error, "k--", lw=1, label="the error itself")
    axes.set(
        xlabel="share removed", ylabel="mean EPE-S over that of all", ylim=(0, 1.2), title="Sparsification"
    )
    axes.legend()


def draw_lengths(axes: Any, figures: SmearFigures) -> None:
    """Median of predicted over true length by octave; bars are the spread of its logarithm."""
    middle = [1.5 * o.from_px for o in figures.octaves]
    ratio = [o.length_ratio for o in figures.octaves]
    axes.errorbar(middle, ratio, [r * o.length_spread for r, o in zip(ratio, figures.octaves, strict=True)])
    axes.axhspan(0.95, 1.05, alpha=0.2)
    axes.set(xscale="log", ylim=(0, 2), xlabel="true length, px", ylabel="predicted / true", title="Lengths")
