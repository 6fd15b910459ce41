"""Show what is found in many photographs, on one page to judge by eye.

``python -m tools.reports.gallery PHOTO... --out gallery.webp`` draws the overlay of each. With ``--plain``
they are drawn on grey instead of the photographs, whose licences may not allow showing them. One photograph
alone is drawn wider: ``python -m tools.reports.gallery models/sample.jpg --out tools/results/sample.webp``.
With ``--masks`` what moves is shown instead of the smears.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import blur2view
from blur2view import draw_overlay, segment
from blur2view.results.drawing import INK, PAPER, write
from blur2view.results.mask_overlay import draw_motion
from tools.arguments import Existing, Target, run
from tools.pages import write_picture

Picture = NDArray[np.uint8]

GREY = 0.25  # what stands for a photograph that is not shown
COLUMNS = 2
TILE_PX = 640  # width of an overlay on the page
ALONE_PX = 960  # width of an overlay that has the page to itself


def tile(path: Path, network: blur2view.SmearNetwork, plain: bool, masks: bool, width: int) -> Picture:
    """Return one photograph's overlay, or its motion mask, so many pixels wide, under its name."""
    image = blur2view.read_image(path)
    found = blur2view.estimate(image, network=network)
    backdrop = np.full_like(image, GREY) if plain else image
    overlay = draw_motion(backdrop, segment(found, image)) if masks else draw_overlay(backdrop, found)
    height = round(overlay.shape[0] * width / overlay.shape[1])
    small = np.asarray(cv2.resize(overlay, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    title = np.full((24, width, 3), PAPER, np.uint8)
    write(title, path.stem, (8, 17), colour=INK)
    return np.vstack([title, small])


def page(tiles: list[Picture]) -> Picture:
    """Return tiles of one width side by side, COLUMNS in a row."""
    if len(tiles) == 1:
        return tiles[0]
    rows = [tiles[start : start + COLUMNS] for start in range(0, len(tiles), COLUMNS)]
    strips = [np.zeros((max(map(len, row)), COLUMNS * TILE_PX, 3), np.uint8) for row in rows]
    for strip, row in zip(strips, rows, strict=True):
        for k, one in enumerate(row):
            strip[: len(one), k * TILE_PX : (k + 1) * TILE_PX] = one
    return np.vstack(strips)


def main(
    photographs: list[Existing],
    *,
    out: Target,
    plain: bool = False,
    masks: bool = False,
    model: Existing | None = None,
) -> None:
    """Write the page as WebP."""
    network = blur2view.SmearNetwork(model)
    width = TILE_PX if len(photographs) > 1 else ALONE_PX
    write_picture(out, page([tile(path, network, plain, masks, width) for path in photographs]))


if __name__ == "__main__":
    run(main)
