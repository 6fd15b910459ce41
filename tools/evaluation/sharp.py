"""Sharp and smooth photographs as they are: how much of them is called moved.

``python -m tools.evaluation.sharp PHOTOS...`` prints, of the photographs of folders, how many are "no
motion", the share of their area that is sure of a smear, and the worst of them.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from blur2view.smears.grid import SmearGrid
from tools.evaluation.even_blur import photograph_parser, photographs_of
from tools.pages import table

LEAST_PX = 2.0  # shorter smears are within what a sharp lens leaves
SURE = 0.5  # a smear is sure whose sigma is at most this share of its length
WORST = 5


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One photograph: its verdict, the median of its smears in px, and the share sure of one."""

    name: str
    verdict: str
    length_px: float
    sure_share: float


def lengths_px(grid: SmearGrid) -> AnyArray:
    """Return the lengths of the smears of all cells."""
    return np.hypot(grid.cells[..., 0], grid.cells[..., 1])


def sure_share(grid: SmearGrid) -> float:
    """Return the share of cells that are sure of a smear."""
    length = lengths_px(grid)
    return float(np.mean((length >= LEAST_PX) & (grid.cells[..., 2] <= SURE * length)))


def reading_of(path: Path, network: blur2view.SmearNetwork) -> Reading:
    """Estimate one photograph."""
    found = blur2view.estimate(blur2view.read_image(path), network=network)
    assert found.grid is not None
    return Reading(
        name=path.stem,
        verdict=f"{found.geometry.config}: {found.geometry.reason}",
        length_px=float(np.median(lengths_px(found.grid))),
        sure_share=sure_share(found.grid),
    )


def page(rows: list[Reading]) -> str:
    """Return means over photographs, then the worst, as Markdown."""
    still = sum("no motion" in row.verdict for row in rows)
    share, length = np.mean([row.sure_share for row in rows]), np.median([row.length_px for row in rows])
    head = f"{still} of {len(rows)} without motion; {share:.2%} of the area is sure of a smear;"
    worst = sorted(rows, key=lambda row: -row.sure_share)[:WORST]
    cells = [(row.name, f"{row.length_px:.2f}", f"{row.sure_share:.2%}", row.verdict) for row in worst]
    return "\n".join([f"{head} median {length:.2f} px", "", *table("worst | px | sure | verdict", cells)])


def main() -> None:
    """Command line."""
    arguments = photograph_parser(__doc__).parse_args()
    network = blur2view.SmearNetwork(arguments.model)
    print(page([reading_of(path, network) for path in photographs_of(arguments.photos)]))


if __name__ == "__main__":
    main()
