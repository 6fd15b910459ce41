"""Shards: stacked examples in files that a stopped run goes on from; rendered scenes for training in them.

``python -m tools.datasets.shards render/train --scenes 6000 --photos KODAK`` renders seeds 0 to 5999 in
all processes the machine has; run again, it goes on where it stopped. A scene's ``linear`` (H, W, 3) is the
uint16 code of the radiance (:func:`decode_linear`), ``displacement`` (H/4, W/4, 2) float16 pixels, not finite
where they overflow, ``labels`` uint8: 1 valid + 2 static.
"""

import multiprocessing
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.errors import Blur2ViewError
from tools.arguments import Existing, run
from tools.processes import single_threaded_pool
from tools.rendering.render import RenderOptions, render

Example = dict[str, AnyArray]
"""The arrays of an example, or, stacked, those of a shard."""

SHARD = 50  # scenes in one file
WHITE = 4.0  # largest radiance that is stored


def write_shards(
    out: Path, numbers: Iterable[int], examples: Callable[[int], Iterable[Example]], name: str = "{:06d}"
) -> None:
    """Write the shards that are missing, in one thread; a reader sees all of one or nothing."""
    cv2.setNumThreads(1)
    out.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        path = out / f"{name.format(number)}.npz"
        if path.exists():
            continue
        began, rows = time.perf_counter(), list(examples(number))
        temporary = path.with_suffix(".part")
        with temporary.open("wb") as file:
            stacked: dict[str, Any] = {key: np.stack([row[key] for row in rows]) for key in rows[0]}
            np.savez(file, **stacked)
        temporary.replace(path)
        print(path, f"{time.perf_counter() - began:.0f} s", flush=True)


def load_shard(path: Path) -> Example:
    """Return the arrays of a shard, as soon as there is one."""
    while not path.exists():
        time.sleep(2.0)
    with np.load(path) as file:
        return dict(file)


def require_shards(folder: Path) -> list[Path]:
    """Return the finished shards of a folder; Blur2ViewError if there are none."""
    if paths := sorted(folder.glob("*.npz")):
        return paths
    raise Blur2ViewError(f"no scenes in {folder}: run python -m tools.datasets.shards {folder}")


def encode_linear(linear: AnyArray) -> AnyArray:
    """Return radiance (0 to 4) as uint16 of its square root: fine in the dark, room for highlights."""
    return np.asarray(np.sqrt(np.clip(linear, 0, WHITE) / WHITE) * 65535 + 0.5).astype(np.uint16)


def decode_linear(coded: AnyArray) -> AnyArray:
    """Return the inverse of :func:`encode_linear`: float32."""
    root = coded.astype(np.float32) * np.float32(np.sqrt(WHITE) / 65535)
    return np.asarray(root * root)


def training_record(seed: int, options: RenderOptions) -> Example:
    """Return one scene rendered for training."""
    scene = render(seed, options)
    labels = scene.valid.astype(np.uint8) + 2 * scene.static.astype(np.uint8)
    displacement = scene.displacement.astype(np.float16)
    return {"linear": encode_linear(scene.linear), "displacement": displacement, "labels": labels}


def write_scenes(out: Path, seeds: range, options: RenderOptions, jobs: int, shard: int = SHARD) -> None:
    """Render what is missing of `seeds`, rounded up to whole files of `shard` scenes."""
    record, starts = partial(training_record, options=options), seeds[::shard]
    with single_threaded_pool(jobs) as pool:

        def examples(start: int) -> Iterable[Example]:
            return pool.map(record, range(start, start + shard), chunksize=2)

        write_shards(out, starts, examples, f"{options.split}_{{:08d}}")


def main(
    out: Path,
    *,
    scenes: int = 12,
    first: int = 0,
    photos: Existing | None = None,
    size: tuple[int, int] = RenderOptions.size,
    jobs: int = multiprocessing.cpu_count(),
) -> None:
    """Render scenes, seeds from ``first`` on, with a folder of further photographs as textures."""
    write_scenes(out, range(first, first + scenes), RenderOptions(size=size, photos=photos), jobs)


if __name__ == "__main__":
    run(main)
