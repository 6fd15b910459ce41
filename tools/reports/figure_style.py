"""Figures and pictures as small files, the same bytes for the same figure."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 110
COLOURS = 96
WEBP_QUALITY = 85


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_picture(picture: NDArray[np.uint8], path: Path) -> None:
    """Write a picture (H, W, 3) RGB that holds photographs as WebP, which has a tenth of a PNG's bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture).save(path, "WEBP", quality=WEBP_QUALITY, method=6)


def save(figure: Figure, path: Path, dpi: int = DPI) -> None:
    """Write a PNG of few colours, which plots need; the same figure gives the same bytes."""
    raw = io.BytesIO()
    figure.savefig(raw, dpi=dpi, format="png", facecolor="white", metadata={"Software": None})
    with Image.open(raw) as picture:
        flat = picture.convert("RGB").quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    path.parent.mkdir(parents=True, exist_ok=True)
    flat.save(path, "PNG", optimize=True)
