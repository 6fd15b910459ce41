"""Photographs of one kind for `tools.evaluation.segmentation`: rendered scenes, or things.

``python -m tools.datasets.mover_scenes render/movers --scenes 12`` writes ``NNNN.png`` and ``NNNN.npz`` as
`tools.datasets.testset` does, of seeds of their own, with 1 to 40 % of every picture moving: few scenes of
the test split hold movers. ``--kind still`` renders scenes in which nothing moves. The other kinds are those
of `tools.rendering.things` and need ``--photos``: a camera that follows a thing, crosses its way, or stands,
and three in which nothing moves by itself.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from tools.arguments import Existing, run
from tools.datasets.testset import test_options, write_photographed, write_truth
from tools.rendering.render import Rendering, RenderOptions, render
from tools.rendering.shaken import ShakeOptions, processed
from tools.rendering.textures import load_photos
from tools.rendering.things import KINDS, ThingOptions, photographed_things

FIRST_SEED = {"movers": 6_000_000, "still": 9_000_000, "things": 10_000_000}
THINGS = [kind.__name__ for kind in KINDS]
SMALLEST, LARGEST = 0.01, 0.4
TRIES = 50  # seeds per scene that is wanted, at most


def suits(scene: Rendering) -> bool:
    """Whether something large enough moves, and smears are as long as those of the test split."""
    shortest, longest = test_options(None).smear_px
    share = float((scene.valid & ~scene.static).mean())
    return SMALLEST <= share <= LARGEST and shortest <= scene.median_px <= longest


def write_rendered(
    out: Path, scenes: int, options: RenderOptions, first_seed: int, wanted: Callable[[Rendering], bool]
) -> None:
    """Write the first rendered scenes that are wanted, in order of their seeds."""
    done = 0
    for seed in range(first_seed, first_seed + TRIES * scenes):
        scene = render(seed, options)
        if wanted(scene):
            write_photographed(out / f"{done:04d}.npz", scene, np.random.default_rng([seed, 2]))
            done += 1
        if done == scenes:
            return
    raise SystemExit(f"only {done} of {scenes} scenes suit, of {TRIES * scenes} seeds")


def write_things(out: Path, scenes: int, photos: Path, kind: str) -> None:
    """Write pictures of things of a kind."""
    sources = load_photos([photos])
    options = ThingOptions(kinds=tuple(float(name == kind) for name in THINGS))
    for index in range(scenes):
        rng = np.random.default_rng([FIRST_SEED["things"], THINGS.index(kind), index])
        things = photographed_things(rng, sources, options)
        picture = np.clip(processed(rng, things.linear, ShakeOptions(size=options.size))[0], 0, 255)
        static = things.moving <= 0.5
        truth = {"displacement": things.displacement, "valid": np.ones_like(static), "static": static}
        unknown = {"K": np.eye(3), "R": np.eye(3), "t": np.zeros(3), "F": None, "kind": kind}
        write_truth(out / f"{index:04d}.npz", picture.astype(np.uint8), **truth, **unknown)


def main(
    out: Path,
    *,
    scenes: int = 12,
    kind: Literal[
        "movers", "still", "following", "crossing", "standing", "deep", "unmoved", "flat"
    ] = "movers",
    photos: Existing | None = None,
) -> None:
    """Write so many scenes of a kind; things are made of photographs in a folder."""
    options = test_options(None)
    if (kind in THINGS) != (photos is not None):
        raise SystemExit("--photos belongs to kinds of things, and they need it")
    out.mkdir(parents=True, exist_ok=True)
    if any(out.iterdir()):
        raise SystemExit(f"{out} is not empty")
    if photos is not None:
        write_things(out, scenes, photos, kind)
    elif kind == "movers":
        write_rendered(out, scenes, replace(options, mover_share=1.0), FIRST_SEED[kind], suits)
    else:
        write_rendered(out, scenes, replace(options, mover_share=0.0), FIRST_SEED[kind], lambda _: True)


if __name__ == "__main__":
    run(main)
