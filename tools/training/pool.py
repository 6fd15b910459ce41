"""The newest shards of the reader's examples, in memory, and batches drawn from them."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from blur2view.smears.likelihood import DIRECTIONS
from tools.training.reader_data import Example

Batch = dict[str, Tensor]
PICTURE_CELLS = 80
"""Cells of a picture of 320x256, which sizes of batches are counted in."""


class Pool:
    """The newest shards, in memory."""

    def __init__(self, folder: Path, most: int) -> None:
        self.folder, self.most = folder, most
        self.shards: dict[int, Example] = {}

    def grow_to(self, count: int) -> None:
        """Hold the newest of the first `count` shards; wait for those that are still being made."""
        wanted = range(max(0, count - self.most), count)
        self.shards = {number: shard for number, shard in self.shards.items() if number in wanted}
        for number in wanted:
            if number not in self.shards:
                self.shards[number] = load_shard(wait_for(self.folder / f"{number:06d}.npz"))

    def batch(self, rng: np.random.Generator, count: int) -> Batch:
        """Return random examples of one size, half mirrored: `count`, or as many cells in larger ones.

        Sizes are as frequent as their shards.
        """
        shards = [shard for _, shard in sorted(self.shards.items())]
        cells = cells_in(shards[int(rng.integers(len(shards)))])
        alike = [shard for shard in shards if cells_in(shard) == cells]
        rows = []
        for _ in range(max(1, count * PICTURE_CELLS // cells)):
            shard = alike[int(rng.integers(len(alike)))]
            k = int(rng.integers(len(shard["v0"])))
            row = {key: array[k] for key, array in shard.items()}
            rows.append(mirrored(row) if rng.random() < 0.5 else row)
        return {key: torch.from_numpy(np.stack([row[key] for row in rows])).float() for key in rows[0]}


def cells_in(shard: Example) -> int:
    """Return how many cells a picture of a shard has."""
    return int(np.prod(shard["v0"].shape[1:3]))


def wait_for(path: Path, poll_s: float = 2.0) -> Path:
    """Return a path as soon as there is a file."""
    while not path.exists():
        time.sleep(poll_s)
    return path


def load_shard(path: Path) -> Example:
    """Return the arrays of a shard."""
    with np.load(path) as file:
        return {key: file[key] for key in file.files}


def mirrored(row: Example) -> Example:
    """Mirror an example left to right: its cells, its directions (k becomes -k) and its truth."""
    back = (-np.arange(DIRECTIONS)) % DIRECTIONS
    flipped = {key: array[:, ::-1] for key, array in row.items()}
    for k in range(octaves_of(row)):
        flipped[f"C{k}"] = flipped[f"C{k}"][:, :, back]
        flipped[f"d{k}"] = flipped[f"d{k}"] * np.array([-1, 1], row[f"d{k}"].dtype)
    return flipped


def octaves_of(row: Mapping[str, Any]) -> int:
    """Return how many octaves an example, or a batch of them, holds."""
    return sum(key.startswith("v") for key in row)
