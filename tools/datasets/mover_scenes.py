"""Rendered photographs in each of which something moves by itself: few scenes of the test split hold any.

``python -m tools.datasets.mover_scenes render/movers --scenes 12`` writes ``NNNN.png`` and ``NNNN.npz`` as
`tools.datasets.testset` does, of seeds of their own, with 1 to 40 % of every picture moving.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from tools.arguments import parser_of
from tools.datasets.testset import test_options, write_truth
from tools.rendering.render import Rendering, RenderOptions, render
from tools.rendering.sensor import SensorOptions, photograph

FIRST_SEED = 6_000_000
SMALLEST, LARGEST = 0.01, 0.4
TRIES = 50  # seeds per scene that is wanted, at most


def moving_share(scene: Rendering) -> float:
    """Return the share of the picture that moves by itself and whose smear is known."""
    return float((scene.valid & ~scene.static).mean())


def suits(scene: Rendering, options: RenderOptions) -> bool:
    """Whether something large enough moves, and smears are as long as those of the test split."""
    if not SMALLEST <= moving_share(scene) <= LARGEST:
        return False
    median = np.median(np.linalg.norm(scene.displacement[scene.valid], axis=-1))
    return bool(options.smear_px[0] <= median <= options.smear_px[1])


def write_mover_scenes(out: Path, scenes: int, options: RenderOptions, first_seed: int = FIRST_SEED) -> None:
    """Write the first ``scenes`` that suit, in order of their seeds, to a new or empty folder."""
    out.mkdir(parents=True, exist_ok=True)
    if any(out.iterdir()):
        raise SystemExit(f"{out} is not empty")
    done = 0
    for seed in range(first_seed, first_seed + TRIES * scenes):
        scene = render(seed, options)
        if suits(scene, options):
            picture = photograph(np.random.default_rng([seed, 2]), scene.linear, SensorOptions())
            cv2.imwrite(str(out / f"{done:04d}.png"), picture[..., ::-1])
            write_truth(out / f"{done:04d}.npz", scene)
            done += 1
        if done == scenes:
            break
    if done < scenes:
        raise SystemExit(f"only {done} of {scenes} scenes suit, of {TRIES * scenes} seeds")


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--scenes", type=int, default=12)
    arguments = parser.parse_args()
    write_mover_scenes(arguments.out, arguments.scenes, replace(test_options(None), mover_share=1.0))


if __name__ == "__main__":
    main()
