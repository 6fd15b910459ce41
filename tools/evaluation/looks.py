"""What looks at photographs say: how often something else than `estimate`, and how often the right name.

``python -m tools.evaluation.looks FOLDERS --cells 48 96 --out PAGE`` estimates the photographs of folders as
`blur2view estimate` and as `blur2view triage` do, with first looks of other numbers of windows. Photographs
of more than 0.65 megapixels `estimate` names by looks, too, so that they can only differ by these numbers.
With ``--sides 640 1280 --closer 48 96`` sharp photographs of folders are blurred in every way that has a
name, of these longer sides, and named by all windows, and by closer looks of so many. ``--every`` takes one
of so many photographs. The constants of `blur2view.networks` cite both.
"""

import time
from collections.abc import Iterator, Sequence
from functools import cache, partial
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import blur2view
from blur2view import Blur
from blur2view.arrays import AnyArray
from blur2view.images.image import read_picture
from blur2view.networks import look, smear_network
from blur2view.networks.smear_network import Detail
from tools.command import Existing, Target, mapped, publish, run, table
from tools.datasets.blurred_photographs import pictures_of, radiance_of
from tools.rendering.textures import photographs_of

NAMED_HEAD = "longer side | named by | pictures | rightly | networks see | processor s"
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


class Named(NamedTuple):
    """Whether one way names a picture rightly, whether networks saw it, seconds."""

    rightly: bool
    networks: bool
    seconds: float


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


def named(image: AnyArray, closer: int | None) -> tuple[Blur, tuple[bool, float]]:
    """Return the blur by closer looks of so many windows, or by all, whether networks saw it, seconds."""
    vars(smear_network)["NAMED_WHOLE_PX"] = inf if closer is None else 0
    vars(smear_network)["CLOSER_CELLS"] = closer
    start = time.process_time()
    found = blur2view.estimate(
        image, network=network(), detail=Detail.GEOMETRY if closer is None else Detail.RANKING, geometry=False
    )
    return found.blur, (found.moving is not None, time.process_time() - start)


def names_of(k: int, paths: Sequence[Path], side: int, ways: Sequence[int | None]) -> list[list[Named]]:
    """Return what each way says of the k-th photograph, blurred in every way that has a name."""
    rng, others = np.random.default_rng(k), [path for path in paths if path != paths[k]] or paths
    rows = list[list[Named]]()
    for picture in pictures_of(rng, radiance_of(paths[k], side), others, composites=4):
        found = [named(picture.image, way) for way in ways]
        rows.append([Named(blur.kind == picture.kind, *cost) for blur, cost in found])
    return rows


def named_rows(
    side: int, ways: Sequence[int | None], found: Sequence[list[Named]]
) -> Iterator[tuple[Any, ...]]:
    """Yield a row of each way to name pictures of a side; both halves of them are counted apart."""
    for way, some in zip(ways, zip(*found, strict=True), strict=True):
        yield (
            side,
            "all windows" if way is None else f"looks of {way}",
            f"{len(some[::2])}; {len(some[1::2])}",
            f"{sum(one.rightly for one in some[::2])}; {sum(one.rightly for one in some[1::2])}",
            sum(one.networks for one in some),
            f"{np.mean([one.seconds for one in some]):.3f}",
        )


def main(
    folders: list[Existing],
    *,
    cells: list[int] | None = None,
    sides: list[int] | None = None,
    closer: list[int] | None = None,
    every: int = 1,
    out: Target | None = None,
    jobs: int = 1,
) -> None:
    """Look at all photographs of folders in every way and write the page."""
    paths = [path for path in photographs_of(folders) if not path.name.endswith(".truth.png")][::every]
    if sides is not None:
        ways, every_row = (None, *(closer or [look.CLOSER_CELLS])), list[tuple[Any, ...]]()
        for side in sides:
            work = partial(names_of, paths=paths, side=side, ways=ways)
            every_row += named_rows(
                side, ways, [one for some in mapped(work, range(len(paths)), jobs) for one in some]
            )
        publish(out, table(NAMED_HEAD, every_row))
        return
    counts = cells or [look.CELLS]
    found = list(mapped(partial(looks_at, cells=counts), paths, jobs))
    publish(out, table(HEAD, rows(found, counts)))


if __name__ == "__main__":
    run(main)
