"""How often a look at a photograph says something else than `estimate`, and how often it asks for more.

``python -m tools.evaluation.looks FOLDERS --cells 48 96 --out PAGE`` estimates the photographs of folders as
`blur2view estimate` and as `blur2view triage` do, with looks of other numbers of windows. ``--every`` takes
one of so many photographs. Photographs of more than 0.65 megapixels `estimate` names by looks, too, so that
they can only differ by the number of windows. `blur2view.networks.look` cites it.
"""

import time
from collections.abc import Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import blur2view
from blur2view import Blur
from blur2view.arrays import AnyArray
from blur2view.images.image import read_picture
from blur2view.networks import look, smear_network
from blur2view.networks.smear_network import Detail
from tools.command import Existing, Target, mapped, publish, run, table
from tools.rendering.textures import photographs_of

HEAD = "look | windows an octave | photographs | other name | asks on | rank of widths | processor s"


class Look(NamedTuple):
    """What one way to look at a photograph found: its blur, whether more windows were read, seconds."""

    blur: Blur
    closer: bool
    seconds: float

    @property
    def width_px(self) -> float:
        """Width of all blur, as `--best` compares it."""
        return float(np.hypot(self.blur.smear_px or 0.0, 3**0.5 * (self.blur.defocus_px or 0.0)))


@cache
def network() -> blur2view.SmearNetwork:
    """Return the shipped network, which each process reads once."""
    return blur2view.SmearNetwork(threads=1)


def looked(image: AnyArray, detail: Detail, cells: int) -> Look:
    """Return what `estimate` finds in a look of a detail, of so many cells if it is the cheap one."""
    vars(smear_network)["CELLS"] = cells  # which `SmearNetwork.predict` looks up
    start = time.process_time()
    found = blur2view.estimate(image, network=network(), detail=detail, geometry=False)
    seconds = time.process_time() - start
    first = network().predict(image, detail=detail)
    return Look(found.blur, first.stride != found.grid.stride, seconds)


def looks_at(path: Path, cells: Sequence[int]) -> list[Look]:
    """Return the estimate of a photograph, and what looks of so many cells find."""
    image = read_picture(path).pixels
    ways = [(Detail.GEOMETRY, cells[0]), *((Detail.RANKING, count) for count in cells)]
    return [looked(image, *way) for way in ways]


def rows(found: Sequence[Sequence[Look]], cells: Sequence[int]) -> Iterator[tuple[object, ...]]:
    """Yield a row of each way to look."""
    for name, count, looks in zip(
        ["`estimate`", *["`triage`"] * len(cells)], ["all", *cells], zip(*found, strict=True), strict=True
    ):
        pairs = [(one[0], look) for one, look in zip(found, looks, strict=True)]
        other = sum(estimate.blur.kind != look.blur.kind for estimate, look in pairs)
        widths = np.array([(estimate.width_px, look.width_px) for estimate, look in pairs]).T
        rank = np.corrcoef(np.argsort(np.argsort(widths))).min() if len(pairs) > 1 else 1.0
        seconds = np.mean([look.seconds for look in looks])
        yield (
            name,
            count,
            len(looks),
            other,
            sum(look.closer for look in looks),
            f"{rank:.3f}",
            f"{seconds:.3f}",
        )


def main(
    folders: list[Existing],
    *,
    cells: list[int] | None = None,
    every: int = 1,
    out: Target | None = None,
    jobs: int = 1,
) -> None:
    """Look at all photographs of folders in every way and write the page."""
    paths = [path for path in photographs_of(folders) if not path.name.endswith(".truth.png")][::every]
    counts = cells or [look.CELLS]
    found = list(mapped(partial(looks_at, cells=counts), paths, jobs))
    publish(out, table(HEAD, rows(found, counts)))


if __name__ == "__main__":
    run(main)
