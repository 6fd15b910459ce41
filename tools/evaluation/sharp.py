"""Sharp and smooth photographs as they are: how much of them is called moved.

``python -m tools.evaluation.sharp PHOTOS...`` prints, of the photographs of folders, how many are "no
motion", the share of their area that is sure of a smear, and the worst of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import blur2view
from blur2view.smears.grid import SmearGrid
from tools.arguments import existing, parser_of

LEAST_PX = 2.0
"""Shorter smears are within what a sharp lens leaves."""
SURE = 0.5
"""A smear is sure whose sigma is at most this share of its length."""
WORST = 5


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One photograph: its verdict, the median of its smears in px, and the share sure of one."""

    name: str
    verdict: str
    length_px: float
    sure_share: float


def sure_share(grid: SmearGrid) -> float:
    """Return the share of cells that are sure of a smear."""
    length, sigma = np.hypot(grid.cells[..., 0], grid.cells[..., 1]), grid.cells[..., 2]
    return float(np.mean((length >= LEAST_PX) & (sigma <= SURE * length)))


def reading_of(path: Path, network: blur2view.SmearNetwork) -> Reading:
    """Estimate one photograph."""
    found = blur2view.estimate(blur2view.read_image(path), network=network)
    grid = found.grid
    assert grid is not None
    return Reading(
        name=path.stem,
        verdict=f"{found.geometry.config}: {found.geometry.reason}",
        length_px=float(np.median(np.hypot(grid.cells[..., 0], grid.cells[..., 1]))),
        sure_share=sure_share(grid),
    )


def table(rows: list[Reading]) -> str:
    """Return means over photographs, then the worst, as lines of Markdown."""
    still = sum("no motion" in row.verdict for row in rows)
    share, length = np.mean([row.sure_share for row in rows]), np.median([row.length_px for row in rows])
    lines = [
        f"{still} of {len(rows)} without motion; {share:.2%} of the area is sure of a smear;"
        f" median {length:.2f} px",
        "",
        "| worst | px | sure | verdict |",
        "|---|---|---|---|",
    ]
    for row in sorted(rows, key=lambda row: -row.sure_share)[:WORST]:
        lines.append(f"| {row.name} | {row.length_px:.2f} | {row.sure_share:.2%} | {row.verdict} |")
    return "\n".join(lines)


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("photos", type=existing, nargs="+", help="folders of sharp photographs")
    parser.add_argument("--model", type=existing, help="ONNX file; the shipped one by default")
    arguments = parser.parse_args()
    network = blur2view.SmearNetwork(arguments.model)
    paths = [p for folder in arguments.photos for p in sorted(folder.iterdir())]
    rows = [reading_of(path, network) for path in paths if path.suffix in (".png", ".jpg")]
    if not rows:
        raise SystemExit("no photograph there")
    print(table(rows))


if __name__ == "__main__":
    main()
