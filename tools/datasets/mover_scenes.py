"""Rendered photographs in each of which something moves by itself: few scenes of the test split hold any.

``python -m tools.datasets.mover_scenes render/movers --scenes 12`` writes ``NNNN.png`` and ``NNNN.npz`` as
`tools.datasets.testset` does, of seeds of their own, with 1 to 40 % of every picture moving.

With ``--training PHOTOS`` they are what `tools.training.train_movers` learns from, with textures of the
training split, of one ``--kind``: ``rendered`` with movers and ``still`` ones without, an eighth of either by
a camera at rest; ``shaken`` photographs, in most of them a second surface that moves otherwise; ``standing``
ones before which one moves; ``sharp`` photographs, reduced.
"""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.arguments import existing, parser_of
from tools.datasets.testset import test_options, write_photographed
from tools.rendering.render import Rendering, RenderOptions, render
from tools.rendering.shaken import ShakeOptions, cell_centres, processed, sample_paths, shake
from tools.rendering.textures import read_photograph, split_files

FIRST_SEED = 6_000_000
SMALLEST, LARGEST = 0.01, 0.4
TRIES = 50  # seeds per scene that is wanted, at most
LARGEST_TRAINING = 0.45
SOURCE_PX, SHARP_PX = 1600, (1024, 768)  # longer sides of surfaces, and of sharp photographs by turns
SHAKE = ShakeOptions(size=(640, 480), short_share=0.0)
SHAKEN = {
    "shaken": replace(SHAKE, smear_px=(2.0, 60.0), mover_share=0.75, still_share=0.12),
    "standing": replace(SHAKE, smear_px=(4.0, 50.0), mover_share=1.0, still_share=1.0),
}


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


def write_shaken(out: Path, photos: Path, scenes: int, series: int, options: ShakeOptions) -> None:
    """Write shaken photographs; the larger of two surfaces is what the camera sees stand still."""
    files = split_files("train", photos)
    for index in range(scenes):
        rng = np.random.default_rng([series, index])
        sources = [_reduced(files[k], SOURCE_PX) for k in rng.integers(len(files), size=3)]
        paths = sample_paths(deepcopy(rng), options)  # which shake draws first
        shaken = shake(rng, sources, options)
        displacement, valid = shaken.displacement, shaken.valid
        picture = np.clip(processed(rng, shaken.linear, options)[0], 0, 255).astype(np.uint8)
        cv2.imwrite(str(out / f"{index:04d}.png"), picture[..., ::-1])
        ground = paths[0].smears(cell_centres(options.size))
        static = np.isclose(displacement, ground, atol=1e-3).all(axis=-1)
        static = static if static.mean() > 0.5 else ~static
        truth = {"displacement": displacement, "valid": valid, "static": static, "F": np.zeros((0, 3))}
        np.savez(out / f"{index:04d}.npz", **truth)  # type: ignore[arg-type]


def write_sharp(out: Path, photos: Path) -> None:
    """Write every second training photograph, reduced as web sites do, as JPEG."""
    for index, path in enumerate(split_files("train", photos)[::2]):
        small = _reduced(path, SHARP_PX[index % 2])
        quality = [cv2.IMWRITE_JPEG_QUALITY, 92]
        cv2.imwrite(str(out / f"{path.stem}.jpg"), small[..., ::-1], quality)


def _reduced(path: Path, longest_px: int) -> NDArray[np.uint8]:
    """Return an RGB photograph whose longer side has at most so many pixels."""
    image = read_photograph(path)
    scale = longest_px / max(image.shape[:2])
    if scale < 1:
        small = cv2.resize(
            np.ascontiguousarray(image), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA
        )
        image = np.asarray(small, np.uint8)
    return np.ascontiguousarray(image)


def write_training(out: Path, photos: Path, kind: str, scenes: int, seed: int) -> None:
    """Write training photographs of one kind."""
    options = replace(test_options(photos), sharp_share=0.12, split="train")
    if kind == "rendered":
        moving = replace(options, mover_share=1.0)
        write_rendered(out, scenes, moving, seed, lambda s: SMALLEST <= moving_share(s) <= LARGEST_TRAINING)
    elif kind == "still":
        write_rendered(out, scenes, replace(options, mover_share=0.0), seed, lambda _: True)
    elif kind == "sharp":
        write_sharp(out, photos)
    else:
        write_shaken(out, photos, scenes, seed, SHAKEN[kind])


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--training", type=existing, metavar="PHOTOS", help="folder of photographs")
    parser.add_argument("--kind", choices=("rendered", "still", "sharp", *SHAKEN), default="rendered")
    parser.add_argument("--seed", type=int, default=60_000_000, help="of the first training scene")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if any(arguments.out.iterdir()):
        raise SystemExit(f"{arguments.out} is not empty")
    if arguments.training is not None:
        write_training(arguments.out, arguments.training, arguments.kind, arguments.scenes, arguments.seed)
    else:
        options = replace(test_options(None), mover_share=1.0)
        write_rendered(arguments.out, arguments.scenes, options, FIRST_SEED, suits)


if __name__ == "__main__":
    main()
