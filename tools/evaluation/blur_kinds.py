"""Which blur a photograph has: sharp, out of focus, moved, both, or at rest before something that moves.

``python -m tools.evaluation.blur_kinds PHOTOS... --out FOLDER`` blurs every sharp photograph of folders in
all these ways (`tools.datasets.blurred_photographs`), asks `blur2view.estimate` for the name of each, and
prints, and writes as ``blur_kinds.md``: names by kind and size of blur, and of dim pictures; errors of the
radius; how well sharp is told from blurred, beside the variance of the Laplacian. Everything follows from the
photographs and ``--seed``, whatever the number of ``--jobs``.
"""

import functools
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from blur2view.results.photograph import Photograph
from blur2view.smears.blur import Blur, BlurKind
from tools.arguments import Existing, run
from tools.datasets.blurred_photographs import Picture, pictures_of, radiance_of
from tools.evaluation.even_blur import photographs_of
from tools.metrics import auc, best_accuracy
from tools.pages import joined, publish, table
from tools.processes import mapped

UNUSABLE_RADIUS_PX, UNUSABLE_SMEAR_PX = 3, 6  # from which a picture counts as blurred; less is not judged
RADIUS_ERROR = 0.15  # relative error that still counts as right
KINDS = " | ".join(BlurKind)

Estimator = Callable[[AnyArray], blur2view.Estimate]
"""What estimates the blur of a picture (H, W, 3), float32 in [0, 1]."""


def laplacian_variance(image: AnyArray) -> float:
    """Return the variance of the Laplacian of the grey levels of a picture (H, W, 3), float32 in [0, 1]."""
    grey = cv2.cvtColor((image * 255).round().astype(np.uint8), cv2.COLOR_RGB2GRAY)
    return float(cv2.Laplacian(grey, cv2.CV_64F).var())


@functools.cache
def loaded(model: Path | None) -> blur2view.SmearNetwork:
    """Return a network, which each process reads once."""
    return blur2view.SmearNetwork(model, threads=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """A picture (without its pixels), what is said of it, and its measures of blur, larger if less sharp.

    Of a camera at rest ``moves`` is the share of the picture that moves.
    """

    picture: Picture
    said: Blur
    blur: dict[str, float]
    moves: float

    @property
    def is_unusable(self) -> bool:
        """Whether the blur counts as such, where only sharp or not is asked."""
        return self.picture.radius_px >= UNUSABLE_RADIUS_PX or self.picture.smear_px >= UNUSABLE_SMEAR_PX


def seen(picture: Picture, estimator: Estimator) -> Seen:
    """Return what is said of a picture."""
    image = blur2view.read_image(Path(picture.name + picture.suffix), content=picture.file)
    said, moves = estimator(image).blur, 0.0 if picture.moving is None else (picture.moving > 0).mean()
    record = Photograph(name="", smear_px=said.smear_px, defocus_px=said.defocus_px)
    blur = {"ours: width of the blur": record.width_px or 0.0}
    blur["variance of the Laplacian"] = -laplacian_variance(image)
    return Seen(picture=replace(picture, file=b"", moving=None), said=said, blur=blur, moves=float(moves))


def of_photograph(
    k: int, paths: Sequence[Path], model: Path | None, seed: int, composites: int
) -> list[Seen]:
    """Return all pictures of the k-th photograph, seen; every other one has polygons for discs."""
    others = [path for path in paths if path != paths[k]] or paths
    rng = np.random.default_rng([seed, k])
    pictures = pictures_of(rng, radiance_of(paths[k]), others, k % 2 == 1, composites)
    return [seen(picture, partial(blur2view.estimate, network=loaded(model))) for picture in pictures]


def name_lines(rows: list[Seen]) -> list[str]:
    """Return the names by kind and size of the blur, and of all that are clearly of a kind."""
    groups: dict[str, list[BlurKind]] = {}
    wholes: dict[str, list[BlurKind]] = {}
    for one in rows:
        groups.setdefault(one.picture.name, []).append(one.said.kind)
        if one.is_unusable and not one.picture.coding:
            wholes.setdefault(f"{one.picture.kind}, all that counts as blurred", []).append(one.said.kind)
    lines = [(name, len(kinds), *map(kinds.count, BlurKind)) for name, kinds in (groups | wholes).items()]
    return table(f"blur | pictures | {KINDS}", lines)


def radius_lines(rows: list[Seen]) -> list[str]:
    """Return the errors of the radius of what is only out of focus, by radius and by shape."""
    groups: dict[str, list[float]] = {}
    for one in (one for one in rows if one.picture.kind == BlurKind.OUT_OF_FOCUS):
        shape = "polygons" if one.picture.blades else "discs"
        names = [f"{one.picture.radius_px:g} px"]
        names += [f"{shape}, from {UNUSABLE_RADIUS_PX} px"] * one.is_unusable
        for name in names:
            groups.setdefault(name, []).append((one.said.defocus_px or 0) / one.picture.radius_px)
    lines = []
    for name in sorted(groups):
        error = np.abs(np.array(groups[name]) - 1)
        figures = (np.median(groups[name]), np.median(error), (error <= RADIUS_ERROR).mean())
        lines.append((name, len(error), *(f"{figure:.3f}" for figure in figures)))
    return table("radius | pictures | found over true | relative error | within 15 %", lines)


def sharpness_lines(rows: list[Seen]) -> list[str]:
    """Return how well every measure tells the sharp from the blurred, over all kinds and by kind."""
    plain = [one for one in rows if not one.picture.coding]
    sharp = [one for one in plain if one.picture.kind == BlurKind.SHARP]
    far = [one for one in plain if one.is_unusable]
    kinds = (BlurKind.OUT_OF_FOCUS, BlurKind.CAMERA_MOVED, BlurKind.OUT_OF_FOCUS_AND_MOVED)
    lines = []
    for name in sharp[0].blur:
        low, high = ([one.blur[name] for one in some] for some in (sharp, far))
        parts = [[one.blur[name] for one in far if one.picture.kind == kind] for kind in kinds]
        figures = (*(auc(low, part) for part in (high, *parts)), *best_accuracy(low, high))
        lines.append((name, *(f"{figure:.3f}" for figure in figures)))
    head = f"measure | AUC, all kinds | {' | '.join(kinds)} | best accuracy | mean of both classes"
    return [f"{len(sharp)} sharp, {len(far)} blurred pictures.", "", *table(head, lines)]


def page(rows: list[Seen]) -> str:
    """Return all tables as Markdown."""
    rest = [(one.moves, one.said.moving_share) for one in rows if one.picture.kind == BlurKind.CAMERA_AT_REST]
    moves, found = np.mean(rest, axis=0) if rest else (0.0, 0.0)
    shares = f"Before a camera at rest {moves:.2f} of the pictures moves, and {found:.2f} are said to move."
    parts = {"Names": name_lines, "Radius": radius_lines, "Sharp or not": sharpness_lines}
    blocks = (block for title, part in parts.items() for block in (f"## {title}", part(rows)))
    return joined(*blocks, shares)


def main(
    photos: list[Existing],
    *,
    model: Existing | None = None,
    out: Path | None = None,
    composites: int = 4,
    seed: int = 0,
    jobs: int = 1,
) -> None:
    """Print the page, and write it into a folder."""
    paths = photographs_of(photos)
    work = partial(of_photograph, paths=paths, model=model, seed=seed, composites=composites)
    rows = [one for found in mapped(work, range(len(paths)), jobs) for one in found]
    command = f"python -m tools.evaluation.blur_kinds {shlex.join(sys.argv[1:])}"
    publish(f"# Kinds of blur\n\n`{command}`\n\n{page(rows)}", out and out / "blur_kinds.md")


if __name__ == "__main__":
    run(main)
