"""One look for all figures: colours that the colour-blind can tell apart, plain axes, small files."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PIL import Image

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
PALETTE = (BLUE, ORANGE, GREEN, VERMILION, SKY, PURPLE, YELLOW, BLACK)
"""Okabe and Ito, Color universal design, 2008."""
MAX_BYTES = 300_000
ATTEMPTS = ((110, 0), (110, 256), (110, 96), (90, 96), (75, 96), (60, 64), (45, 48))
"""Dots an inch and colours (0: all) that are tried until a file is small enough."""


@contextmanager
def style() -> Iterator[None]:
    """Draw with the house's colours and sizes of text inside this block."""
    import matplotlib as mpl
    from matplotlib.rcsetup import cycler

    settings: Any = {
        "axes.prop_cycle": cycler(color=PALETTE),
        "axes.grid": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.titlesize": 10,
        "axes.labelsize": 9,
        "grid.alpha": 0.3,
        "font.size": 9,
        "legend.fontsize": 8,
        "legend.frameon": False,
        "xtick.labelsize": 8,
        "ytick.labelsize": 8,
    }
    with mpl.rc_context(settings):
        yield


def new_figure(width_in: float, height_in: float) -> Figure:
    """Make an empty figure that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def show_picture(axes: Any, picture: Any, title: str = "") -> None:
    """Show a picture without axes; the centre of its first pixel is at (0, 0)."""
    axes.imshow(picture, interpolation="antialiased")
    axes.set(xlim=(-0.5, picture.shape[1] - 0.5), ylim=(picture.shape[0] - 0.5, -0.5), xticks=[], yticks=[])
    axes.set_title(title)
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(False)


def save(figure: Figure, path: Path) -> Path:
    """Write a PNG of at most MAX_BYTES, with fewer colours and then fewer dots if it must be.

    Raises
    ------
    ValueError
        If no attempt is small enough.
    """
    for dpi, colours in ATTEMPTS:
        encoded = rendered(figure, dpi, colours)
        if len(encoded) <= MAX_BYTES:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(encoded)
            return path
    raise ValueError(f"{path.name} stays above {MAX_BYTES} bytes, draw less")


def rendered(figure: Figure, dpi: int, colours: int) -> bytes:
    """Encode a figure as PNG; the same figure gives the same bytes."""
    raw, small = io.BytesIO(), io.BytesIO()
    figure.savefig(raw, dpi=dpi, format="png", facecolor="white", metadata={"Software": None})
    with Image.open(raw) as picture:
        flat = picture.convert("RGB")
    flat = flat.quantize(colours, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE) if colours else flat
    flat.save(small, "PNG", optimize=True)
    return small.getvalue()
