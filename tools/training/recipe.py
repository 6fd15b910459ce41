"""Make the shipped network: render, write examples, train, export.

``python -m tools.training.recipe --photos FOLDER... --work runs/recipe --models models`` makes
``smear.onnx`` with the figures below; each stage goes on where it was when the line is run again.
"""

from __future__ import annotations

import argparse
import multiprocessing
from dataclasses import dataclass
from pathlib import Path

from tools.arguments import existing
from tools.datasets.shards import require_shards, write_shards
from tools.processes import start_worker
from tools.rendering.render import RenderOptions
from tools.rendering.textures import load_photos
from tools.training import reader_data
from tools.training.export_reader import export
from tools.training.reader_data import Sources
from tools.training.train_reader import ReaderTraining, train

SHARD = 50
"""Scenes in one file."""
SMALL, LARGE = (320, 256), (640, 512)
"""Widths and heights of the rendered scenes that the reader is shown."""


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """What networks of the shipped kind are made of; the shipped reader was trained in stages.

    Attributes
    ----------
    scenes, large_scenes : int
        Rendered scenes, seeds 0 on, and after them those twice as large.
    val_scenes, val_seed : int
        Scenes of the held-out textures for the figures on the way, and the first of their seeds.
    shards, steps : int
        Shards of the reader's examples, and its optimiser steps.
    processes : int
        Processes that make examples; what they make does not depend on how many they are.
    """

    scenes: int = 900
    large_scenes: int = 180
    val_scenes: int = 100
    val_seed: int = 900_000
    shards: int = 400
    steps: int = 16000
    processes: int = 2


def render_all(recipe: Recipe, photos: Path | None, work: Path) -> tuple[Path, Path]:
    """Render what is missing of both sets; return their folders."""
    train, val = work / "train", work / "val"
    held = range(recipe.val_seed, recipe.val_seed + recipe.val_scenes)
    count = recipe.scenes, recipe.scenes + recipe.large_scenes
    render_set(train, range(count[0]), RenderOptions(size=SMALL, photos=photos))
    render_set(train, range(*count), RenderOptions(size=LARGE, photos=photos))
    render_set(val, held, RenderOptions(size=SMALL, split="test", photos=photos))
    return train, val


def render_set(folder: Path, seeds: range, options: RenderOptions) -> None:
    """Render what is missing of one set."""
    for path in write_shards(folder, seeds, options, multiprocessing.cpu_count(), SHARD):
        print(path, flush=True)


def make(recipe: Recipe, photos: list[Path], work: Path, models: Path) -> None:
    """Make the smear network, with surfaces of the photographs in these folders.

    Rendered scenes have procedural textures and photographs of scikit-image, so none held out is in a folder.
    """
    scenes, held = render_all(recipe, None, work)
    write_examples(recipe, photos, scenes, held, work)
    training = ReaderTraining(
        train=work / "examples", val=work / "held", out=work / "run", steps=recipe.steps, shards=recipe.shards
    )
    train(training)
    models.mkdir(parents=True, exist_ok=True)
    export(training.out / "last.pt", models / "smear.onnx")


def write_examples(recipe: Recipe, photos: list[Path], scenes: Path, held: Path, work: Path) -> None:
    """Write the examples that are missing, and one shard, of held-out scenes alone, for the figures."""
    only = Sources(photos=[], scenes=require_shards(held), rendered_share=1.0)
    reader_data.write_shards(work / "held", range(recipe.val_seed, recipe.val_seed + 1), only)
    sources = Sources(photos=load_photos(photos), scenes=require_shards(scenes))
    count = recipe.processes
    parts = [(work / "examples", range(k, recipe.shards, count), sources) for k in range(count)]
    if count == 1:
        reader_data.write_shards(*parts[0])
        return
    with multiprocessing.get_context("spawn").Pool(count, start_worker) as pool:
        pool.starmap(reader_data.write_shards, parts)


def main() -> None:
    """Command line."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument(
        "--photos", type=existing, nargs="+", required=True, help="folders of sharp photographs"
    )
    parser.add_argument("--work", type=Path, default=Path("runs/recipe"), help="(default: %(default)s)")
    parser.add_argument("--models", type=Path, default=Path("models"), help="(default: %(default)s)")
    for name in ("scenes", "large_scenes", "val_scenes", "shards", "steps"):
        option, default = f"--{name.replace('_', '-')}", getattr(Recipe, name)
        parser.add_argument(option, type=int, default=default, help="(default: %(default)s)")
    given = vars(parser.parse_args())
    photos, work, models = (given.pop(name) for name in ("photos", "work", "models"))
    make(Recipe(**given), photos, work, models)


if __name__ == "__main__":
    main()
