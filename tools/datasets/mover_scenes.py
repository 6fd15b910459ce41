"""Photographs for `tools.evaluation.segmentation`: rendered scenes with movers, and still ones, and things.

``python -m tools.datasets.mover_scenes render/movers --scenes 12`` writes ``NNNN.png`` and ``NNNN.npz`` as
`tools.datasets.testset` does, of seeds of their own, with 1 to 40 % of every picture moving: few scenes of the
test split hold movers. ``--kind still`` renders scenes in which nothing moves; ``--kind things`` makes things
before photographs, of all kinds by turns (`tools.rendering.things`), and needs ``--photos``.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from tools.arguments import existing, parser_of
from tools.datasets.testset import test_options, write_photographed
from tools.rendering.render import Rendering, RenderOptions, render
from tools.rendering.shaken import ShakeOptions, processed
from tools.rendering.things import KINDS, ThingOptions, photographed_things
from tools.training.reader_data import load_photos

FIRST_SEED = {"movers": 6_000_000, "still": 9_000_000, "things": 10_000_000}
SMALLEST, LARGEST = 0.01, 0.4
TRIES = 50  # seeds per scene that is wanted, at most


def moving_share(scene: Rendering) -> float:
    """Return the share of the picture that moves by itself and whose smear is known."""
    return float((scene.valid & ~scene.static).mean())


def suits(scene: Rendering) -> bool:
    """Whether something large enough moves, and smears are as long as those of the test split."""
    shortest, longest = test_options(None).smear_px
    return SMALLEST <= moving_share(scene) <= LARGEST and shortest <= scene.median_px <= longest


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


def write_things(out: Path, scenes: int, photos: Path, first_seed: int) -> None:
    """Write pictures of things, of the kinds by turns; the name of the kind is that of the file."""
    sources = load_photos([photos])
    for index in range(scenes):
        rng, kind = np.random.default_rng(first_seed + index), index % len(KINDS)
        options = ThingOptions(kinds=tuple(float(k == kind) for k in range(len(KINDS))))
        things = photographed_things(rng, sources, options)
        picture = np.clip(processed(rng, things.linear, ShakeOptions(size=options.size))[0], 0, 255)
        path = out / f"{things.kind}_{index:04d}.png"
        cv2.imwrite(str(path), picture.astype(np.uint8)[..., ::-1])
        static = things.moving <= 0.5
        truth = {"displacement": things.displacement, "valid": np.ones_like(static), "static": static}
        np.savez(path.with_suffix(".npz"), **truth, F=np.zeros((0, 3)))  # type: ignore[arg-type]


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--kind", choices=FIRST_SEED, default="movers")
    parser.add_argument("--photos", type=existing, help="folder of photographs for --kind things")
    arguments = parser.parse_args()
    if (arguments.kind == "things") != (arguments.photos is not None):
        parser.error("--kind things needs --photos, which the other kinds do not use")
    arguments.out.mkdir(parents=True, exist_ok=True)
    if any(arguments.out.iterdir()):
        raise SystemExit(f"{arguments.out} is not empty")
    kind, scenes, seed = arguments.kind, arguments.scenes, FIRST_SEED[arguments.kind]
    options = test_options(None)
    if kind == "movers":
        write_rendered(arguments.out, scenes, replace(options, mover_share=1.0), seed, suits)
    elif kind == "still":
        write_rendered(arguments.out, scenes, replace(options, mover_share=0.0), seed, lambda _: True)
    else:
        write_things(arguments.out, scenes, arguments.photos, seed)


if __name__ == "__main__":
    main()
