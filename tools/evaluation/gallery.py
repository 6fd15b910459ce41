"""Make the pictures that README and the results show.

``python -m tools.evaluation.gallery PHOTO... --out gallery.webp`` draws the overlay of each photograph, one
alone wider. ``--plain`` draws them on grey instead of the photographs, whose licences may not allow showing
them, ``--masks`` shows what moves instead of the smears, ``--report`` a report in headless Chromium.
"""

import shutil
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

import blur2view
from blur2view.cli import commands
from blur2view.results.overlay import PAPER, draw_motion, write
from tools.arguments import Existing, Target, run
from tools.pages import write_picture

Picture = NDArray[np.uint8]

GREY = 0.25  # what stands for a photograph that is not shown
COLUMNS = 2
TILE_PX, ALONE_PX = 640, 960  # width of an overlay on a page, and of one that has the page to itself
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = ("--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1280,800")


def tile(path: Path, network: blur2view.SmearNetwork, plain: bool, masks: bool, width: int) -> Picture:
    """Return one photograph's overlay, or its motion mask, so many pixels wide, under its name."""
    image = blur2view.read_image(path)
    found = blur2view.estimate(image, network=network)
    shown = np.full_like(image, GREY) if plain else image
    overlay = (
        draw_motion(shown, blur2view.segment(found, image)) if masks else blur2view.draw_overlay(shown, found)
    )
    height = round(overlay.shape[0] * width / overlay.shape[1])
    small = np.asarray(cv2.resize(overlay, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    title = np.full((24, width, 3), PAPER, np.uint8)
    write(title, path.stem, (8, 17))
    return np.vstack([title, small])


def side_by_side(tiles: list[Picture]) -> Picture:
    """Return tiles of one width, COLUMNS in a row."""
    rows = [tiles[start : start + COLUMNS] for start in range(0, len(tiles), COLUMNS)]
    strips = [np.zeros((max(map(len, row)), COLUMNS * TILE_PX, 3), np.uint8) for row in rows]
    for strip, row in zip(strips, rows, strict=True):
        for k, one in enumerate(row):
            strip[: len(one), k * TILE_PX : (k + 1) * TILE_PX] = one
    return np.vstack(strips)


def screenshot(photographs: list[Path]) -> Picture:
    """Return a picture of the report of photographs, and say how large it is; SystemExit without Chromium."""
    if (chromium := next(filter(None, map(shutil.which, BROWSERS)), None)) is None:
        raise SystemExit("no Chromium here; apt-get install chromium")
    with tempfile.TemporaryDirectory() as folder:
        report, shot = Path(folder) / "report.html", Path(folder) / "shot.png"
        commands.main(["report", *map(str, photographs), "-o", str(report)])
        words = [chromium, *OPTIONS, f"--screenshot={shot}", report.as_uri()]
        subprocess.run(words, check=True, capture_output=True)
        print(f"{report.stat().st_size / 1e6:.2f} MB")
        with Image.open(shot) as shown:
            return np.asarray(shown.convert("RGB"))


def main(
    photographs: list[Existing],
    *,
    out: Target,
    plain: bool = False,
    masks: bool = False,
    report: bool = False,
) -> None:
    """Write the picture as WebP."""
    if report:
        write_picture(out, screenshot(photographs))
        return
    network, width = blur2view.SmearNetwork(), TILE_PX if len(photographs) > 1 else ALONE_PX
    tiles = [tile(path, network, plain, masks, width) for path in photographs]
    write_picture(out, side_by_side(tiles) if len(tiles) > 1 else tiles[0])


if __name__ == "__main__":
    run(main)
