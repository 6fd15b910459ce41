"""Which blur a photograph has: sharp, out of focus, moved, both, or at rest before something that moves.

``python -m tools.evaluation.blur_kinds PHOTOS... --out tools/results/blur_kinds.md`` blurs every sharp
photograph of folders in all these ways (`tools.datasets.blurred_photographs`), estimates each, and writes the
names by kind and size of blur, and of dim pictures, how many triage names otherwise, and errors of smears.
The page follows from the photographs and ``--seed``, whatever the number of ``--jobs``.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import blur2view
from blur2view import BlurKind
from blur2view.networks.smear_network import Detail
from tools.command import Existing, Target, mapped, publish, run, table
from tools.datasets.blurred_photographs import Picture, pictures_of, radiance_of
from tools.metrics import direction_error_deg
from tools.rendering.textures import photographs_of

MIN_RADIUS_PX, MIN_SMEAR_PX = 3, 6  # from which a picture counts as blurred


class Seen(NamedTuple):
    """A picture (without its pixels) and its estimate.

    ``triaged`` is the kind that triage names, which reads fewer windows; ``direction_deg`` and ``sure_deg``
    are median errors of all smears and of the half of surer directions, ``length_px`` is its median and
    ``moving`` the share that is said to move.
    """

    picture: Picture
    kind: BlurKind
    triaged: BlurKind
    direction_deg: float
    sure_deg: float
    length_px: float
    moving: float

    @property
    def is_clear(self) -> bool:
        """Whether the picture is blurred enough that its name counts."""
        picture = self.picture
        enough = picture.radius_px >= MIN_RADIUS_PX or picture.smear_px >= MIN_SMEAR_PX
        return enough and not picture.coding


@cache
def loaded(model: Path | None) -> blur2view.SmearNetwork:
    """Return a network, which each process reads once."""
    return blur2view.SmearNetwork(model, threads=1)


def seen(picture: Picture, network: blur2view.SmearNetwork) -> Seen:
    """Return a picture and its estimate."""
    estimate = blur2view.estimate(picture.image, network=network)
    field, true = estimate.grid.at_pixels(), np.array([np.cos(picture.angle), np.sin(picture.angle)])
    error_deg = direction_error_deg(field.displacement, true)
    sure = field.sigma_rad <= np.median(field.sigma_rad)
    blur = estimate.blur
    look = blur2view.estimate(picture.image, network=network, detail=Detail.RANKING, geometry=False)
    return Seen(
        picture=replace(picture, image=np.empty(0)),
        kind=blur.kind,
        triaged=look.blur.kind,
        direction_deg=float(np.median(error_deg)),
        sure_deg=float(np.median(error_deg[sure])),
        length_px=float(np.median(field.length_px[sure])),
        moving=blur.moving_share,
    )


def of_photograph(
    k: int, paths: Sequence[Path], model: Path | None, seed: int, composites: int
) -> list[Seen]:
    """Return all blurred pictures of the k-th photograph and their estimates."""
    others = [path for path in paths if path != paths[k]] or paths
    rng = np.random.default_rng([seed, k])
    pictures = pictures_of(rng, radiance_of(paths[k]), others, composites)
    return [seen(picture, loaded(model)) for picture in pictures]


def grouped(rows: list[Seen], name: Callable[[Seen], str]) -> dict[str, list[Seen]]:
    """Return pictures by a name that each is given."""
    return {key: [one for one in rows if name(one) == key] for key in dict.fromkeys(map(name, rows))}


def named_rows(rows: list[Seen]) -> Iterator[tuple[object, ...]]:
    """Yield the names by kind and size of the blur, and of all that are clearly of a kind."""
    clear = [one for one in rows if one.is_clear]
    groups = grouped(rows, lambda one: one.picture.name)
    groups |= grouped(clear, lambda one: f"{one.picture.kind}, all that counts as blurred")
    for name, some in groups.items():
        yield name, len(some), *([one.kind for one in some].count(kind) for kind in BlurKind)


def smear_rows(rows: list[Seen]) -> Iterator[tuple[object, ...]]:
    """Yield medians over pictures of the errors of smears, by length, and over all."""
    moved = [one for one in rows if one.picture.kind == BlurKind.CAMERA_MOVED and not one.picture.coding]
    for name, some in (grouped(moved, lambda one: f"{one.picture.smear_px:g} px") | {"all": moved}).items():
        ratio = np.array([one.length_px / one.picture.smear_px for one in some])
        degrees = np.median([(one.direction_deg, one.sure_deg) for one in some], axis=0)
        figures = (*degrees, np.median(ratio), (np.abs(ratio - 1) < 0.05).mean())
        yield name, len(some), *(f"{figure:.3f}" for figure in figures)


def page(rows: list[Seen]) -> Iterator[str | list[str]]:
    """Yield all tables as Markdown."""
    yield table(f"blur | pictures | {' | '.join(BlurKind)}", named_rows(rows))
    rest = [(one.picture.moving, one.moving) for one in rows if one.picture.kind == BlurKind.CAMERA_AT_REST]
    if rest:
        moves, found = np.mean(rest, axis=0)
        yield f"Before a camera at rest {moves:.2f} of the pictures moves, and {found:.2f} are said to move."
    differ = sum(one.kind != one.triaged for one in rows)
    yield f"`triage` gives {differ} of {len(rows)} photographs another name than `estimate` does."
    head = "smear | pictures | direction, deg | surer half | length over true | within 5 %"
    yield from ("## Even smears", table(head, smear_rows(rows)))


def main(
    photos: list[Existing],
    *,
    model: Existing | None = None,
    out: Target | None = None,
    composites: int = 4,
    seed: int = 0,
    jobs: int = 1,
) -> None:
    """Blur all photographs of folders and write the page."""
    paths = photographs_of(photos)
    work = partial(of_photograph, paths=paths, model=model, seed=seed, composites=composites)
    publish(out, *page([one for found in mapped(work, range(len(paths)), jobs) for one in found]))


if __name__ == "__main__":
    run(main)
