"""Training crops of rendered scenes: geometry is rendered once, cameras are drawn anew for every crop."""

from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from blur2view.arrays import AnyArray as Array
from tools.datasets.shards import Example, decode_linear, load_shards
from tools.rendering.exposure import GRID
from tools.rendering.sensor import log_uniform, photograph

VALIDATION_CROPS, VALIDATION_SIDE, VALIDATION_SEED = 128, 240, 12345
LONGEST_PX = 400  # displacements from here on, and those that overflowed when stored, become invalid zeros


def orient(
    image: Array, displacement: Array, labels: Array, turns: int, mirror: bool
) -> tuple[Array, Array, Array]:
    """Turn counter-clockwise by 90 degrees `turns` times, then mirror left to right: picture and truth."""
    image, displacement, labels = (np.rot90(a, turns) for a in (image, displacement, labels))
    for _ in range(turns):
        displacement = np.stack([displacement[..., 1], -displacement[..., 0]], -1)
    if mirror:
        image, labels = image[:, ::-1], labels[:, ::-1]
        displacement = displacement[:, ::-1] * np.array([-1, 1], displacement.dtype)
    return image, displacement, labels


def cut(rng: np.random.Generator, scenes: Example, index: int, side: int) -> tuple[Array, Array, Array]:
    """Cut a square of one scene at a random place and scale: linear (side, side, 3) and its grid truth."""
    height, width = scenes["linear"].shape[1:3]
    magnified = log_uniform(rng, (0.6, 1.35)) if rng.random() < 0.5 else 1.0
    source = int(min(side / magnified, height, width)) // GRID * GRID
    x, y = (int(rng.integers(0, (extent - source) // GRID + 1)) * GRID for extent in (width, height))
    linear = decode_linear(scenes["linear"][index, y : y + source, x : x + source])
    cells = (index, slice(y // GRID, (y + source) // GRID), slice(x // GRID, (x + source) // GRID))
    displacement, labels = scenes["displacement"][cells].astype(np.float32), scenes["labels"][cells]
    return (linear, displacement, labels) if source == side else resized(linear, displacement, labels, side)


def resized(linear: Array, displacement: Array, labels: Array, side: int) -> tuple[Array, Array, Array]:
    """Resize a square picture and its truth to `side` pixels; displacements grow with the picture."""
    scale, cells = side / len(linear), (side // GRID, side // GRID)
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    picture = np.asarray(cv2.resize(linear, (side, side), interpolation=how))
    nearest = np.asarray(cv2.resize(displacement, cells, interpolation=cv2.INTER_NEAREST_EXACT))
    labels = np.asarray(cv2.resize(labels, cells, interpolation=cv2.INTER_NEAREST_EXACT))
    return picture, nearest * np.float32(scale), labels


def crop(rng: np.random.Generator, scenes: Example, index: int, side: int) -> tuple[Array, Array]:
    """Make one augmented training pair, float32.

    An image (3, side, side) in [0, 1], and its finite target (3, side / 4, side / 4): displacement x, y in
    pixels and validity (0 or 1).
    """
    linear, displacement, labels = cut(rng, scenes, index, side)
    turns, mirror = int(rng.integers(4)), bool(rng.random() < 0.5)
    linear, displacement, labels = orient(linear, displacement, labels, turns, mirror)
    image = photograph(rng, np.ascontiguousarray(linear)).astype(np.float32) / 255
    usable = np.all(np.abs(displacement) < LONGEST_PX, axis=-1, keepdims=True)  # false for NaN, too
    valid = (labels[..., None] & 1) * usable
    target = np.concatenate([np.where(usable, displacement, 0), valid], -1).astype(np.float32)
    return np.ascontiguousarray(image.transpose(2, 0, 1)), np.ascontiguousarray(target.transpose(2, 0, 1))


class CropBatches(Dataset[tuple[Tensor, Tensor]]):
    """Batches of crops; batch k depends only on (seed, k), whichever process makes it."""

    def __init__(self, scenes: Example, seed: int, batch: int, side: int) -> None:
        self.scenes, self.seed, self.batch, self.side = scenes, seed, batch, side

    def __getitem__(self, k: int) -> tuple[Tensor, Tensor]:
        """Return batch number k: images (N, 3, side, side) and targets (N, 3, side / 4, side / 4)."""
        rng = np.random.default_rng([self.seed, k])
        indices = rng.integers(0, len(self.scenes["labels"]), self.batch)
        pairs = [crop(rng, self.scenes, int(i), self.side) for i in indices]
        images, targets = zip(*pairs, strict=True)
        return torch.from_numpy(np.stack(images)), torch.from_numpy(np.stack(targets))


def validation_crops(folder: Path) -> tuple[Tensor, Tensor]:
    """Cut fixed crops of held-out scenes: the same pictures, cameras and noise for every run."""
    return CropBatches(load_shards(folder), VALIDATION_SEED, VALIDATION_CROPS, VALIDATION_SIDE)[0]
