"""Make the shipped network: render, write examples, train, export.

``python -m tools.training.recipe --photos FOLDER... --work runs/recipe --models models`` makes
``smear.onnx`` of sharp photographs in folders, none of them held out, and of rendered scenes with procedural
textures and photographs of scikit-image: ``--scenes`` small ones, seeds 0 on, after them large ones, and for
the figures on the way others of the held-out textures. Each stage goes on where it was when the line is run
again. The shipped reader was trained in stages.
"""

import multiprocessing
from functools import partial
from pathlib import Path

from tools.arguments import Existing, run
from tools.datasets.shards import require_shards, write_scenes, write_shards
from tools.processes import mapped
from tools.rendering.render import RenderOptions
from tools.rendering.textures import load_photos
from tools.training import export_reader, train_reader
from tools.training.reader_data import Sources, examples

SHARD = 50
"""Scenes in one file."""
SMALL, LARGE = (320, 256), (640, 512)
"""Widths and heights of the rendered scenes that the reader is shown."""
HELD_SCENES, HELD_SEED = 100, 900_000
"""How many scenes figures are of, and the first of their seeds."""


def write_examples(first: int, out: Path, last: int, every: int, sources: Sources) -> None:
    """Write the missing ones of every so many shards of the reader's examples."""
    write_shards(out, range(first, last, every), partial(examples, sources=sources))


def main(
    *,
    photos: list[Existing],
    work: Path = Path("runs/recipe"),
    models: Path = Path("models"),
    scenes: int = 900,
    large_scenes: int = 180,
    val_scenes: int = HELD_SCENES,
    shards: int = 400,
    steps: int = 16000,
    processes: int = 2,
) -> None:
    """Make it; what is made does not depend on the number of processes that make examples."""
    jobs, held = multiprocessing.cpu_count(), range(HELD_SEED, HELD_SEED + val_scenes)
    write_scenes(work / "train", range(scenes), RenderOptions(size=SMALL), jobs, SHARD)
    write_scenes(work / "train", range(scenes, scenes + large_scenes), RenderOptions(size=LARGE), jobs, SHARD)
    write_scenes(work / "val", held, RenderOptions(size=SMALL, split="test"), jobs, SHARD)
    only = Sources(photos=[], scenes=require_shards(work / "val"), rendered_share=1.0)
    write_examples(HELD_SEED, work / "held", HELD_SEED + 1, 1, only)
    sources = Sources(photos=load_photos(photos), scenes=require_shards(work / "train"))
    train, out = work / "examples", work / "run"
    parts = partial(write_examples, out=train, last=shards, every=processes, sources=sources)
    mapped(parts, range(processes), processes)
    train_reader.main(train=train, val=work / "held", out=out, steps=steps, shards=shards)
    models.mkdir(parents=True, exist_ok=True)
    export_reader.main(out / "last.pt", models / "smear.onnx")


if __name__ == "__main__":
    run(main)
