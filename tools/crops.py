"""Training crops from rendered shards: geometry is rendered once, cameras are drawn anew for every crop."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import IterableDataset

from tools.render import GRID, decode_linear
from tools.sensor import photograph

Array = NDArray[Any]


def load_shards(folder: Path) -> dict[str, Array]:
    """All scenes of a folder in memory: linear (uint16), displacement (float16), labels (uint8)."""
    paths = sorted(p for p in folder.glob("*.npz") if not p.name.endswith(".tmp.npz"))
    if not paths:
        raise SystemExit(f"no rendered shards in {folder}: run python -m tools.render dataset --out {folder}")
    with np.load(paths[0]) as first:
        merged = {k: np.empty((len(paths) * len(first[k]), *first[k].shape[1:]), first[k].dtype) for k in first.files}
        per_file = len(first["labels"])
    for index, path in enumerate(paths):
        with np.load(path) as shard:
            for key, array in merged.items():
                array[index * per_file : (index + 1) * per_file] = shard[key]
    return merged


def orient(image: Array, displacement: Array, labels: Array, turns: int, mirror: bool) -> tuple[Array, Array, Array]:
    """Turn by 90 degrees `turns` times counter-clockwise, then mirror left to right, image and truth together."""
    image, labels = np.rot90(image, turns), np.rot90(labels, turns)
    displacement = np.rot90(displacement, turns)
    for _ in range(turns):
        displacement = np.stack([displacement[..., 1], -displacement[..., 0]], -1)
    if mirror:
        image, labels = image[:, ::-1], labels[:, ::-1]
        displacement = displacement[:, ::-1] * np.array([-1, 1], displacement.dtype)
    return image, displacement, labels


def cut(
    rng: np.random.Generator, scenes: dict[str, Array], index: int, side: int
) -> tuple[Array, Array, Array]:
    """A square crop of one scene at a random place and scale: linear (side, side, 3) and its grid truth."""
    height, width = scenes["linear"].shape[1:3]
    scale = float(np.exp(rng.uniform(np.log(0.6), np.log(1.35)))) if rng.random() < 0.5 else 1.0
    source = int(min(side / scale, height, width)) // GRID * GRID
    scale = side / source
    x, y = (int(rng.integers(0, (extent - source) // GRID + 1)) * GRID for extent in (width, height))
    linear = decode_linear(scenes["linear"][index, y : y + source, x : x + source])
    grid = (slice(y // GRID, (y + source) // GRID), slice(x // GRID, (x + source) // GRID))
    displacement = scenes["displacement"][index][grid].astype(np.float32)
    labels = scenes["labels"][index][grid]
    if source != side:
        linear = cv2.resize(linear, (side, side), interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        cells = (side // GRID, side // GRID)
        displacement = cv2.resize(displacement, cells, interpolation=cv2.INTER_NEAREST_EXACT) * np.float32(scale)
        labels = cv2.resize(labels, cells, interpolation=cv2.INTER_NEAREST_EXACT)
    return linear, displacement, labels


def crop(rng: np.random.Generator, scenes: dict[str, Array], index: int, side: int) -> tuple[Array, Array]:
    """One augmented training pair.

    Returns
    -------
    image : ndarray of shape (3, side, side)
        float32 RGB in [0, 1].
    target : ndarray of shape (3, side / 4, side / 4)
        Displacement x, y in pixels and validity (0 or 1).
    """
    linear, displacement, labels = cut(rng, scenes, index, side)
    linear, displacement, labels = orient(linear, displacement, labels, int(rng.integers(4)), rng.random() < 0.5)
    image = photograph(rng, np.ascontiguousarray(linear)).astype(np.float32) / 255
    finite = np.isfinite(displacement).all(-1) & (np.abs(displacement) < 400).all(-1)
    displacement = np.where(finite[..., None], displacement, 0)
    target = np.concatenate([displacement, ((labels & 1) * finite)[..., None]], -1).astype(np.float32)
    return np.ascontiguousarray(image.transpose(2, 0, 1)), np.ascontiguousarray(target.transpose(2, 0, 1))


class CropStream(IterableDataset[tuple[torch.Tensor, torch.Tensor]]):
    """Endless batches of crops; batch k depends only on (seed, k), however many workers make them."""

    def __init__(self, scenes: dict[str, Array], seed: int, batch: int, side: int, first: int = 0) -> None:
        super().__init__()
        self.scenes, self.seed, self.batch, self.side, self.first = scenes, seed, batch, side, first

    def __iter__(self) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """Yield (images, targets); with several workers each makes every n-th batch, in order."""
        cv2.setNumThreads(1)
        worker = torch.utils.data.get_worker_info()
        step, offset = (worker.num_workers, worker.id) if worker else (1, 0)
        k = self.first + offset
        while True:
            yield self.make(k)
            k += step

    def make(self, k: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Return batch number k."""
        rng = np.random.default_rng([self.seed, k])
        indices = rng.integers(0, len(self.scenes["labels"]), self.batch)
        pairs = [crop(rng, self.scenes, int(i), self.side) for i in indices]
        images, targets = zip(*pairs, strict=True)
        return torch.from_numpy(np.stack(images)), torch.from_numpy(np.stack(targets))
