"""Which blur a photograph has: sharp, out of focus, moved, both, or at rest before something that moves.

``python -m tools.evaluation.blur_kinds PHOTOS... --out FOLDER`` blurs every sharp photograph of folders in
all these ways (`tools.datasets.blurred_photographs`), asks `blur2view.estimate` for the name of each, and
prints, and writes as ``blur_kinds.md``: names by kind and size of blur; errors of the radius; how well sharp
is told from blurred, beside three measures of sharpness; the same for dim pictures; and what a camera at rest
sees. Everything follows from the photographs and ``--seed``, whatever the number of ``--jobs``.
"""

import functools
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from skimage.measure import blur_effect

import blur2view
from blur2view.arrays import AnyArray
from blur2view.smears.blur import Blur, BlurKind
from blur2view.smears.grid import SmearGrid
from tools.arguments import Existing, run
from tools.datasets.blurred_photographs import Picture, pictures_of, radiance_of
from tools.evaluation.even_blur import photographs_of
from tools.metrics import auc, best_accuracy
from tools.pages import joined, publish, table
from tools.processes import mapped


def grey_levels(image: AnyArray) -> AnyArray:
    """Return the grey levels (H, W), uint8, of a picture (H, W, 3), float32 in [0, 1]."""
    return np.asarray(cv2.cvtColor((image * 255).round().astype(np.uint8), cv2.COLOR_RGB2GRAY))


def laplacian_variance(image: AnyArray) -> float:
    """Return the variance of the Laplacian of a picture's grey levels."""
    return float(cv2.Laplacian(grey_levels(image), cv2.CV_64F).var())


def tenengrad(image: AnyArray) -> float:
    """Return the mean squared gradient (Sobel, 3x3) of a picture's grey levels.

    References
    ----------
    Krotkov, Focusing, International Journal of Computer Vision 1, 1988.
    """
    grey = grey_levels(image)
    return float(sum((cv2.Sobel(grey, cv2.CV_64F, x, 1 - x) ** 2).mean() for x in (0, 1)))


BASELINES: dict[str, Callable[[AnyArray], float]] = {
    "variance of the Laplacian": lambda image: -laplacian_variance(image),
    "Tenengrad": lambda image: -tenengrad(image),
    "`blur_effect` of scikit-image": lambda image: float(blur_effect(grey_levels(image))),
}
"""Measures of the blur of a picture (H, W, 3), float32 in [0, 1]: the larger, the less sharp."""


UNUSABLE_RADIUS_PX, UNUSABLE_SMEAR_PX = 3, 6  # from which a picture counts as blurred; less is not judged
RADIUS_ERROR, LENGTH_ERROR = 0.15, 0.10  # relative errors that still count as right
SURE_PX, SURE_SIGMAS = 3.0, 3.0  # what is longer, in pixels and in deviations, is sure of a smear
KINDS = " | ".join(BlurKind)
OURS = "ours: width of the blur"


Estimator = Callable[[AnyArray], blur2view.Estimate]
"""What estimates the blur of a picture (H, W, 3), float32 in [0, 1]."""


@functools.cache
def loaded(model: Path | None) -> blur2view.SmearNetwork:
    """Return a network, which each process reads once."""
    return blur2view.SmearNetwork(model, threads=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """A picture (without its pixels), what is said of it, and its measures of blur, if sharp or not is asked.

    Of a camera at rest ``moves`` is the share of the picture that moves; ``still_sure`` are the shares that
    are sure of a smear, of cells in which nothing moves and of cells whose window shows nothing that moves.
    """

    photograph: int
    picture: Picture
    said: Blur
    blur: dict[str, float]
    moves: float = 0.0
    still_sure: tuple[float, float] = (0.0, 0.0)


def still_sure(moving: AnyArray, grid: SmearGrid) -> tuple[float, float]:
    """Return the shares of still cells that are sure of a smear, as `Seen` has them; 0 if none is still."""
    smears, stride = grid.smears(), grid.stride
    sure = smears.length_px > np.maximum(SURE_PX, SURE_SIGMAS * smears.sigma_px)
    reach = np.ones(((grid.window_px or stride) - stride + 1,) * 2, np.uint8)
    shares = []
    for mask in (moving > 0, cv2.dilate((moving > 0).astype(np.uint8), reach) > 0):
        still = ~mask.reshape(sure.shape[0], stride, sure.shape[1], stride).any(axis=(1, 3))
        shares.append(float(sure[still].mean()) if still.any() else 0.0)
    return shares[0], shares[1]


def seen(photograph: int, picture: Picture, estimator: Estimator) -> Seen:
    """Return what is said of a picture."""
    image = blur2view.read_image(Path(picture.name + picture.suffix), content=picture.file)
    estimate, moving, blur = estimator(image), picture.moving, dict[str, float]()
    said = estimate.blur
    if not picture.coding and picture.kind != BlurKind.CAMERA_AT_REST:
        blur = {OURS: said.width_px or 0.0} | {name: measure(image) for name, measure in BASELINES.items()}
    found = Seen(photograph=photograph, picture=replace(picture, file=b"", moving=None), said=said, blur=blur)
    if moving is None:
        return found
    sure = still_sure(moving, estimate.grid)
    return replace(found, moves=float((moving > 0).mean()), still_sure=sure)


def of_photograph(
    k: int, paths: Sequence[Path], model: Path | None, seed: int, composites: int
) -> list[Seen]:
    """Return all pictures of the k-th photograph, seen; every other one has polygons for discs."""
    others = [path for path in paths if path != paths[k]] or paths
    rng = np.random.default_rng([seed, k])
    pictures = pictures_of(rng, radiance_of(paths[k]), others, k % 2 == 1, composites)
    return [seen(k, picture, partial(blur2view.estimate, network=loaded(model))) for picture in pictures]


def names_of(some: Iterable[Seen]) -> tuple[int, ...]:
    """Return how many pictures have each name."""
    kinds = [one.said.kind for one in some]
    return tuple(kinds.count(kind) for kind in BlurKind)


def name_lines(rows: list[Seen]) -> list[str]:
    """Return the names by kind and size of the blur, and of all that are clearly of a kind."""
    plain = [one for one in rows if not one.picture.coding]
    groups: dict[str, list[Seen]] = {}
    for one in plain:
        groups.setdefault(one.picture.name, []).append(one)
    for kind, px in ((BlurKind.OUT_OF_FOCUS, UNUSABLE_RADIUS_PX), (BlurKind.CAMERA_MOVED, UNUSABLE_SMEAR_PX)):
        some = [one for one in plain if one.picture.kind == kind and is_unusable(one.picture)]
        groups[f"{kind}, from {px} px"] = some
    return table(f"blur | pictures | {KINDS}", [(k, len(v), *names_of(v)) for k, v in groups.items()])


def is_unusable(picture: Picture) -> bool:
    """Return whether a blur counts as such, where only sharp or not is asked."""
    return picture.radius_px >= UNUSABLE_RADIUS_PX or picture.smear_px >= UNUSABLE_SMEAR_PX


def radius_lines(rows: list[Seen]) -> list[str]:
    """Return the errors of the radius of what is only out of focus, by radius and by shape."""
    groups: dict[str, list[float]] = {}
    for one in rows:
        if one.picture.kind == BlurKind.OUT_OF_FOCUS:
            shape = "polygons" if one.picture.blades else "discs"
            names = [f"{one.picture.radius_px:g} px"]
            names += [f"{shape}, from {UNUSABLE_RADIUS_PX} px"] * is_unusable(one.picture)
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
    judged = [one for one in rows if one.blur]
    sharp = [one for one in judged if one.picture.kind == BlurKind.SHARP]
    far = [one for one in judged if is_unusable(one.picture)]
    kinds = (BlurKind.OUT_OF_FOCUS, BlurKind.CAMERA_MOVED, BlurKind.OUT_OF_FOCUS_AND_MOVED)
    lines = []
    for name in sharp[0].blur:
        low, high = ([one.blur[name] for one in some] for some in (sharp, far))
        parts = [[one.blur[name] for one in far if one.picture.kind == kind] for kind in kinds]
        figures = (*(auc(low, part) for part in (high, *parts)), *best_accuracy(low, high))
        lines.append((name, *(f"{figure:.3f}" for figure in figures)))
    head = f"measure | AUC, all kinds | {' | '.join(kinds)} | best accuracy | mean of both classes"
    return [f"{len(sharp)} sharp, {len(far)} blurred pictures.", "", *table(head, lines)]


def length(one: Seen) -> float:
    """Return the length in pixels that is said of a picture's smears; 0 of what shows none."""
    return one.said.smear_px or 0.0


def dim_lines(rows: list[Seen]) -> list[str]:
    """Return what is said of dim pictures, beside the same pictures at full brightness."""
    dim: dict[str, list[Seen]] = {}
    for one in rows:
        if one.picture.coding:
            dim.setdefault(one.picture.name, []).append(one)
    full = {(one.photograph, one.picture.name): length(one) for one in rows if not one.picture.coding}
    lines = []
    for name, some in dim.items():
        told = [(full[one.photograph, name.partition(",")[0]], one) for one in some]
        pairs = [(length(a), px) for px, a in told if px > 0 and a.said.kind != BlurKind.CANNOT_TELL]
        figures = ("-", "-")
        if pairs and some[0].picture.smear_px:
            ratio = np.divide(*np.transpose(pairs))
            figures = (f"{np.median(ratio):.3f}", f"{(np.abs(ratio - 1) <= LENGTH_ERROR).mean():.2f}")
        long = sum(length(one) > 2 * max(one.picture.smear_px, SURE_PX / 2) for one in some)
        lines.append((name, len(some), *figures, long, *names_of(some)))
    without = f'Ratios without what is called "{BlurKind.CANNOT_TELL}"'
    note = f"{without}; of sharp pictures, smears above {SURE_PX:g} px."
    head = f"blur | pictures | smear over that undimmed | within 10 % | above twice the true one | {KINDS}"
    return [note, "", *table(head, lines)]


def rest_lines(rows: list[Seen]) -> list[str]:
    """Return what is said of a camera at rest before something that moves."""
    some = [one for one in rows if one.picture.kind == BlurKind.CAMERA_AT_REST]
    if not some:
        return ["No composites."]
    named_so = np.mean([one.said.kind == BlurKind.CAMERA_AT_REST for one in some])
    sure = np.mean([one.still_sure for one in some], axis=0)
    moves, found = np.mean([(one.moves, one.said.moving_share) for one in some], axis=0)
    figures = (f"{named_so:.3f}", *(f"{share:.4f}" for share in sure), f"{moves:.2f}", f"{found:.2f}")
    head = "pictures | named so | still cells sure of a smear | of these, nothing in their window moves"
    return table(f"{head} | share that moves | share said to move", [(len(some), *figures)])


def page(rows: list[Seen]) -> str:
    """Return all tables as Markdown."""
    parts = {"Names": name_lines, "Radius": radius_lines, "Sharp or not": sharpness_lines}
    parts |= {"Dim": dim_lines, "At rest": rest_lines}
    return joined(*(block for title, part in parts.items() for block in (f"## {title}", part(rows))))


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
