"""The easiest case there is: sharp photographs under one straight, even smear, known exactly.

``python -m tools.evaluation.even_blur PHOTOS...`` blurs the middle 320x320 px of every photograph of folders
by 4, 6, 10, 20 and 40 px, each in a direction of its own, and prints errors by length: with 0.3 % of noise,
and through the renderer's whole camera model.
"""

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from tools.arguments import existing, parser_of
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


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Medians over one picture and over its half of surer directions: degrees, and length over the truth."""

    length_px: int
    direction_deg: float
    direction_deg_top50: float
    length_ratio: float


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
    """Yield the middle of every photograph of folders that is large enough."""
    pieces = (middle(read_photograph(path)) for path in photographs_of(folders))
    yield from (piece for piece in pieces if piece is not None)


def middle(photo: AnyArray) -> AnyArray | None:
    """Return the middle of a photograph (H, W, 3) uint8 as radiance (320, 320, 3); None if too small."""
    while max(photo.shape[:2]) > LARGEST_PX:
        photo = np.asarray(cv2.resize(photo, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    if min(photo.shape[:2]) < SIDE:
        return None
    y, x = ((extent - SIDE) // 2 for extent in photo.shape[:2])
    return np.asarray((photo[y : y + SIDE, x : x + SIDE] / np.float32(255)) ** np.float32(GAMMA))


def blurred(
    rng: np.random.Generator, radiance: AnyArray, length_px: float, angle: float, sensor: bool
) -> AnyArray:
    """Return the picture (320, 320, 3), float32 in [0, 1], of radiance under one smear."""
    moved = cv2.filter2D(radiance, -1, kernel(length_px, angle), borderType=cv2.BORDER_REFLECT)
    if sensor:
        return photograph(rng, np.asarray(moved)).astype(np.float32) / 255
    noisy = np.clip(moved + NOISE * rng.standard_normal(moved.shape), 0, 1) ** (1 / GAMMA)
    return np.asarray(np.round(noisy * 255).astype(np.float32) / 255)


def reading_of(field: blur2view.SmearField, length_px: int, angle: float) -> Reading:
    """Return how well one picture was read."""
    true = np.broadcast_to(length_px * np.array([np.cos(angle), np.sin(angle)]), field.displacement.shape)
    error_deg = direction_error_deg(field.displacement.reshape(-1, 2), true.reshape(-1, 2))
    sigma = field.sigma_rad.ravel()
    certain = sigma <= np.median(sigma)
    return Reading(
        length_px=length_px,
        direction_deg=float(np.median(error_deg)),
        direction_deg_top50=float(np.median(error_deg[certain])),
        length_ratio=float(np.median(field.length_px.ravel()[certain])) / length_px,
    )


def readings(folders: list[Path], network: blur2view.SmearNetwork, sensor: bool) -> list[Reading]:
    """Return the readings of all photographs of folders at all lengths; the same seed for all networks."""
    rows = []
    rngs = {length_px: np.random.default_rng(length_px) for length_px in LENGTHS_PX}
    for radiance in middles(folders):
        for length_px, rng in rngs.items():
            angle = float(rng.uniform(0, np.pi))
            picture = blurred(rng, radiance, length_px, angle, sensor)
            rows.append(reading_of(network.predict(picture).at_pixels(), length_px, angle))
    return rows


def page(rows: list[Reading]) -> str:
    """Return medians over pictures by length, and over all, as Markdown."""
    lines = []
    for length_px in (*LENGTHS_PX, None):
        some = [row for row in rows if length_px in (None, row.length_px)]
        all_deg, certain_deg = (
            np.median([getattr(row, name) for row in some])
            for name in ("direction_deg", "direction_deg_top50")
        )
        ratio = np.array([row.length_ratio for row in some])
        within, ratio_50 = float(np.mean(np.abs(np.log(ratio)) < 0.05)), f"{np.median(ratio):.3f}"
        figures = (f"{all_deg:.2f}", f"{certain_deg:.2f}", ratio_50, f"{within:.2f}")
        lines.append((length_px or "all", len(some), *figures))
    head = "px | pictures | direction, deg | certain half | length ratio | within 5 %"
    return "\n".join(table(head, lines))


def photograph_parser(text: str | None) -> argparse.ArgumentParser:
    """Return the parser of a tool that reads sharp photographs by a network."""
    parser = parser_of(text)
    parser.add_argument("photos", type=existing, nargs="+", help="folders of sharp photographs")
    parser.add_argument("--model", type=existing, help="ONNX file; the shipped one by default")
    return parser


def main() -> None:
    """Command line."""
    arguments = photograph_parser(__doc__).parse_args()
    network = blur2view.SmearNetwork(arguments.model)
    for sensor in (False, True):
        rows = readings(arguments.photos, network, sensor)
        if not rows:
            raise SystemExit("no photograph of at least 320x320 px there")
        print("\nThrough the whole camera:\n" if sensor else "", page(rows), sep="\n", flush=True)


if __name__ == "__main__":
    main()
