"""A camera's path with the gaps of a model beside the path without, as a picture."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from blur2view.arrays import Array

SIZE, MARGIN, FINER = (470, 330), 34, 2  # of a panel, pixels; drawn this much larger, then reduced
PAPER, INK, FAINT, BLUE, ORANGE = "white", "#222222", "#b9b9b9", "#2266bb", "#e07000"


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A panel: its title, and the points that it shows, each at a place (x, y) of the path."""

    title: str
    line: Array  # (N, 2): the true path
    dots: Mapping[str, Array]  # places (M, 2) by colour
    crosses: Array  # (K, 2)


def draw_paths(panels: Sequence[Panel], target: Path) -> None:
    """Draw panels beside each other, in one scale, into a file of the kind that its ending names."""
    every = np.concatenate(
        [one for panel in panels for one in (panel.line, panel.crosses, *panel.dots.values())]
    )
    low, high = every.min(axis=0), every.max(axis=0)
    room = np.array(SIZE) - 2 * MARGIN
    scale = (room / (high - low)).min()
    width, height = SIZE[0] * len(panels), SIZE[1]
    canvas = Image.new("RGB", (FINER * width, FINER * height), PAPER)
    pen, font = ImageDraw.Draw(canvas), ImageFont.load_default(15 * FINER)
    for k, panel in enumerate(panels):
        corner = np.array([k * SIZE[0], 0]) + MARGIN + (room - scale * (high - low)) / 2 + (0, 8)

        def place(points: Array, corner: Array = corner) -> Array:
            return np.asarray(FINER * (corner + scale * (points - low)))

        pen.text((FINER * (k * SIZE[0] + MARGIN), FINER * 10), panel.title, fill=INK, font=font)
        pen.line([tuple(point) for point in place(panel.line)], fill=FAINT, width=2 * FINER, joint="curve")
        for x, y in place(panel.crosses):
            for sign in (1, -1):
                pen.line([x - 9, y - 9 * sign, x + 9, y + 9 * sign], fill=INK, width=FINER)
        for colour, points in panel.dots.items():
            for x, y in place(points):
                pen.ellipse([x - 10, y - 10, x + 10, y + 10], fill=colour)
    canvas.resize((width, height), Image.Resampling.LANCZOS).save(target, quality=85)
