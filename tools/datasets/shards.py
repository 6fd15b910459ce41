"""Shards: stacked examples in files that a stopped run goes on from."""

import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from blur2view.arrays import AnyArray

Example = dict[str, AnyArray]
"""The arrays of an example, or, stacked, those of a shard."""


def write_shards(out: Path, numbers: Iterable[int], examples: Callable[[int], Iterable[Example]]) -> None:
    """Write the shards that are missing, in one thread; a reader sees all of one or nothing."""
    cv2.setNumThreads(1)
    out.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        path = out / f"{number:06d}.npz"
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
    """Return the arrays of a shard."""
    with np.load(path) as file:
        return dict(file)


def load_shards(folder: Path) -> list[Example]:
    """Return the finished shards of a folder by name; SystemExit if there are none."""
    if paths := sorted(folder.glob("*.npz")):
        return [load_shard(path) for path in paths]
    raise SystemExit(f"no shards in {folder}: run python -m tools.training.reader_data {folder}")
