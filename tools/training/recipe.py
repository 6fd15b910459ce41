"""Make the shipped networks from nothing: render, train, export, quantize; then that of moving things.

``python -m tools.training.recipe --photos KODAK --work runs/recipe --models models`` does all of it, with the
figures below; each stage goes on where it was when the line is run again.
"""

from __future__ import annotations

import argparse
import multiprocessing
from dataclasses import dataclass, field, replace
from pathlib import Path

from tools.datasets.shards import write_shards
from tools.rendering.render import RenderOptions
from tools.training import export_motion, motion_data, train_motion
from tools.training.export_onnx import export
from tools.training.motion_data import MotionExamples
from tools.training.quantize import SCENES, quantize
from tools.training.train import TrainOptions, train_all
from tools.training.train_motion import MotionTraining

SHARD = 50
"""Scenes in one file."""


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """What the shipped network was made of.

    Attributes
    ----------
    scenes : int
        Rendered scenes, seeds 0 on.
    size : tuple of int
        Their width and height in pixels.
    val_scenes, val_seed : int
        Scenes of the held-out textures for the figures on the way, and the first of their seeds.
    steps, more_steps, processes : int
        Optimiser steps from nothing, and of a second schedule that goes on from their averaged weights;
        training processes, whose number decides the result.
    more_rate, more_seed : float, int
        Peak learning rate and seed of the crops of the second schedule.
    calibration_scenes : int
        Rendered photographs that set the ranges of the integers of the fast network.
    motion : MotionTraining
        Schedule of the motion segmentation network.
    """

    scenes: int = 5150
    size: tuple[int, int] = RenderOptions.size
    val_scenes: int = 100
    val_seed: int = 900_000
    steps: int = 10_000
    more_steps: int = 9_000
    more_rate: float = 1.2e-3
    more_seed: int = 1
    processes: int = 2
    calibration_scenes: int = SCENES
    motion: MotionTraining = field(default_factory=MotionTraining)


def render_all(recipe: Recipe, photos: Path | None, work: Path) -> tuple[Path, Path]:
    """Render what is missing of both sets; give their folders."""
    train, val = work / "train", work / "val"
    sets = (
        (train, range(recipe.scenes), "train"),
        (val, range(recipe.val_seed, recipe.val_seed + recipe.val_scenes), "test"),
    )
    for folder, seeds, split in sets:
        options = RenderOptions(size=recipe.size, split=split, photos=photos)
        for path in write_shards(folder, seeds, options, multiprocessing.cpu_count(), SHARD):
            print(path, flush=True)
    return train, val


def make(recipe: Recipe, photos: Path | None, work: Path, models: Path) -> None:
    """Run all stages."""
    train, val = render_all(recipe, photos, work)
    first = TrainOptions(
        train=train, val=val, out=work / "run", steps=recipe.steps, processes=recipe.processes
    )
    train_all(first)
    second = replace(
        first,
        out=work / "run2",
        weights=first.out / "last.pt",
        steps=recipe.more_steps,
        learning_rate=recipe.more_rate,
        seed=recipe.more_seed,
    )
    train_all(second)
    models.mkdir(parents=True, exist_ok=True)
    export(second.out / "last.pt", models / "smear.onnx")
    quantize(models / "smear.onnx", models / "smear_fast.onnx", recipe.calibration_scenes)
    make_motion(recipe, train, work, models)


def make_motion(recipe: Recipe, train: Path, work: Path, models: Path) -> None:
    """Make the motion segmentation network, on what the fast network of ``models`` says of the scenes."""
    examples = work / "motion.npz"
    if not examples.exists():
        made = motion_data.make(train, multiprocessing.cpu_count(), models / "smear_fast.onnx")
        made.save(examples)
    train_motion.train(MotionExamples.load(examples), recipe.motion, work / "motion.pt")
    export_motion.export(work / "motion.pt", models / "motion.onnx")


def main() -> None:
    """Command line."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--photos", type=Path, help="folder of the Kodak suite's 24 PNG files")
    parser.add_argument("--work", type=Path, default=Path("runs/recipe"), help="(default: %(default)s)")
    parser.add_argument("--models", type=Path, default=Path("models"), help="(default: %(default)s)")
    parser.add_argument("--scenes", type=int, default=Recipe.scenes, help="(default: %(default)s)")
    parser.add_argument("--val-scenes", type=int, default=Recipe.val_scenes, help="(default: %(default)s)")
    parser.add_argument("--steps", type=int, default=Recipe.steps, help="(default: %(default)s)")
    parser.add_argument("--more-steps", type=int, default=Recipe.more_steps, help="(default: %(default)s)")
    arguments = parser.parse_args()
    recipe = Recipe(
        scenes=arguments.scenes,
        val_scenes=arguments.val_scenes,
        steps=arguments.steps,
        more_steps=arguments.more_steps,
    )
    make(recipe, arguments.photos, arguments.work, arguments.models)


if __name__ == "__main__":
    main()
