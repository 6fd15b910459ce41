"""The easiest case there is: sharp photographs under one straight, even smear, known exactly.

``python -m tools.evaluation.even_blur PHOTOS...`` blurs the middle 320x320 px of every photograph of folders
by 4, 6, 10, 20 and 40 px, each in a direction of its own, and prints errors by length: with 0.3 % of noise,
and through the renderer's whole camera model.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from tools.arguments import Existing, run
from tools.metrics import direction_error_deg
from tools.pages import table
from tools.rendering.sensor import photograph
from tools.rendering.textures import read_photograph

SIDE = 320
LENGTHS_PX = (4, 6, 10, 20, 40)
SUFFIXES = (".png", ".jpg")
NOISE = 0.003
GAMMA = 2.2
LARGEST_PX = 1600  # larger photographs are halved first: few are sharp at their own size
HEAD = "px | pictures | direction, deg | certain half | length ratio | within 5 %"


def kernel(length_px: float, angle: float) -> AnyArray:
    """Return a box of this length along a direction, bilinear in its pixels, of sum one."""
    side = int(length_px) + 5 | 1
    weights = np.zeros((side, side), np.float32)
    for t in np.linspace(-0.5, 0.5, 801) * length_px:
        x, y = side // 2 + t * np.cos(angle), side // 2 + t * np.sin(angle)
        j, i = int(x), int(y)
        weights[i : i + 2, j : j + 2] += np.outer([i + 1 - y, y - i], [j + 1 - x, x - j])
    return np.asarray(weights / weights.sum())


def photographs_of(folders: Iterable[Path]) -> list[Path]:
    """Return the photographs of folders, by name; without any the tool ends."""
    paths = [path for folder in folders for path in sorted(folder.iterdir()) if path.suffix in SUFFIXES]
    if not paths:
        raise SystemExit(f"no photograph in {', '.join(map(str, folders))}")
    return paths


def middles(folders: Iterable[Path]) -> Iterator[AnyArray]:
    """Yield the middles, as radiance (320, 320, 3), of the photographs of folders that are large enough."""
    for photo in map(read_photograph, photographs_of(folders)):
        while max(photo.shape[:2]) > LARGEST_PX:
            photo = np.asarray(cv2.resize(photo, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
        if min(photo.shape[:2]) >= SIDE:
            y, x = ((extent - SIDE) // 2 for extent in photo.shape[:2])
            middle = photo[y : y + SIDE, x : x + SIDE] / np.float32(255)
            yield np.asarray(middle ** np.float32(GAMMA))


def blurred(
    rng: np.random.Generator, radiance: AnyArray, length_px: float, angle: float, sensor: bool
) -> AnyArray:
    """Return the picture (320, 320, 3), float32 in [0, 1], of radiance under one smear."""
    moved = cv2.filter2D(radiance, -1, kernel(length_px, angle), borderType=cv2.BORDER_REFLECT)
    if sensor:
        return photograph(rng, np.asarray(moved)).astype(np.float32) / 255
    noisy = np.clip(moved + NOISE * rng.standard_normal(moved.shape), 0, 1) ** (1 / GAMMA)
    return np.asarray(np.round(noisy * 255).astype(np.float32) / 255)


def readings(folders: list[Path], network: blur2view.SmearNetwork, sensor: bool) -> AnyArray:
    """Return how all photographs of folders are read at all lengths (N, 4); the same seed for all networks.

    The length; medians of the direction's error, degrees, of all and of the half of surer directions; that
    of this half's length over the truth.
    """
    rows, rngs = [], {length_px: np.random.default_rng(length_px) for length_px in LENGTHS_PX}
    for radiance in middles(folders):
        for length_px, rng in rngs.items():
            angle = float(rng.uniform(0, np.pi))
            field = network.predict(blurred(rng, radiance, length_px, angle, sensor)).at_pixels()
            true = length_px * np.array([np.cos(angle), np.sin(angle)])
            error_deg = direction_error_deg(field.displacement, true)
            certain = field.sigma_rad <= np.median(field.sigma_rad)
            ratio = float(np.median(field.length_px[certain])) / length_px
            rows.append((length_px, np.median(error_deg), np.median(error_deg[certain]), ratio))
    return np.array(rows)


def page(rows: AnyArray) -> str:
    """Return medians over pictures by length, and over all, as Markdown."""
    lines = []
    for length_px in (*LENGTHS_PX, "all"):
        some = rows if length_px == "all" else rows[rows[:, 0] == length_px]
        all_deg, certain_deg, ratio = np.median(some[:, 1:], axis=0)
        within = (np.abs(np.log(some[:, 3])) < 0.05).mean()
        figures = (f"{all_deg:.2f}", f"{certain_deg:.2f}", f"{ratio:.3f}", f"{within:.2f}")
        lines.append((length_px, len(some), *figures))
    return "\n".join(table(HEAD, lines))


def main(photos: list[Existing], *, model: Existing | None = None) -> None:
    """Print both tables, of the shipped network or another."""
    network = blur2view.SmearNetwork(model)
    for sensor in (False, True):
        rows = readings(photos, network, sensor)
        if not len(rows):
            raise SystemExit("no photograph of at least 320x320 px there")
        print("\nThrough the whole camera:\n" if sensor else "", page(rows), sep="\n", flush=True)


if __name__ == "__main__":
    run(main)
