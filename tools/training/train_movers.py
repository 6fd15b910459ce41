"""Fit the small network over half cells that finds movers: ``blur2view/segmentation/movers.npz``.

``python -m tools.training.train_movers SCENES... --out blur2view/segmentation/movers.npz``: folders of
scenes with their truth (`tools.datasets.mover_scenes --training`), and of photographs alone (PNG, JPEG), in
which nothing is blurred or moves. Everything follows from the folders and ``--seed``.

The folders that ``movers.npz`` names are of
`tools.datasets.mover_scenes FOLDER --training PHOTOS --kind KIND --scenes N --seed S`:

- ``dev_movers``, ``dev_movers2``, ``rendered2``, ``rendered3``: ``rendered``, 60, 64, 120 and 240 of the
  seeds 60, 62, 66 and 68 million; ``dev_still``, ``still2``: ``still``, 32 and 40 of 61 and 67 million
- ``shaken``, ``shaken2``: ``shaken``, 360 and 300 of the seeds 72 and 75; ``standing``: 100 of the seed 71
- ``sharp``: ``sharp``
"""

import argparse
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from blur2view.arrays import Array
from blur2view.networks.smear_network import SmearNetwork
from blur2view.photographs.image import read_image
from blur2view.pipeline import estimate
from blur2view.segmentation.camera_motion import Cells, camera_field
from blur2view.segmentation.classifier import DILATIONS
from blur2view.segmentation.evidence import FINER, evidence, gradients_of
from blur2view.smears.grid import SmearGrid
from tools.arguments import existing, parser_of, target
from tools.rendering.exposure import GRID

READ_PX, READ_SHARE = 2.0, 0.25  # error of a smear that is still read right: constant, and of its length
READ_WEIGHT = 0.3  # of the second question, whether a smear is read, in the loss
CHANNELS, DROPOUT = 16, 0.15
EPOCHS, BATCH, RATE, DECAY = 40, 12, 6e-3, 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Evidence (h, w, K) of half cells, the shares (h, w) of each that move and are read, and weights."""

    evidence: Array
    moving: Array
    read: Array
    weight: Array


class Network(nn.Module):
    """The network of `blur2view.segmentation.classifier`."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(inputs, CHANNELS, 1)
        self.middle = nn.ModuleList(nn.Conv2d(CHANNELS, CHANNELS, 3, dilation=d) for d in DILATIONS[1:-1])
        self.last = nn.Conv2d(CHANNELS, 2, 1)
        self.dropout = nn.Dropout2d(DROPOUT)

    @property
    def layers(self) -> list[nn.Conv2d]:
        """All, in order."""
        return [self.first, *self.middle, self.last]

    def forward(self, x: Tensor) -> Tensor:
        """Return log-odds (N, 2, h, w) of evidence (N, K, h, w)."""
        x = self.dropout(functional.relu(self.first(x)))
        for layer, dilation in zip(self.middle, DILATIONS[1:-1], strict=True):
            x = functional.relu(layer(functional.pad(x, (dilation,) * 4, mode="replicate")))
        return self.last(x)  # type: ignore[no-any-return]


def smears_of(
    path: Path, image: NDArray[np.float32], network: SmearNetwork, cache: Path | None
) -> tuple[SmearGrid, Array | None]:
    """Return the smears of a photograph and F, if there is one; kept in a folder, for another training."""
    stored = None if cache is None else cache / network.info.model_id / path.parent.name / f"{path.stem}.npz"
    if stored is not None and stored.exists():
        with np.load(stored) as file:
            grid = SmearGrid(cells=file["cells"], stride=int(file["stride"]), shape=image.shape[:2])
            return grid, file["F"] if file["F"].size else None
    found = estimate(image, network=network)
    if stored is not None:
        stored.parent.mkdir(parents=True, exist_ok=True)
        F = np.zeros(0) if found.geometry.F is None else found.geometry.F
        np.savez(stored, cells=found.grid.cells, stride=found.grid.stride, F=F)
    return found.grid, found.geometry.F


def scene_of(path: Path, network: SmearNetwork, cache: Path | None) -> Scene:
    """Return the evidence of a photograph and its truth; without a truth nothing in it is blurred."""
    image = read_image(path)
    grid, F = smears_of(path, image, network, cache)
    cells = Cells.of(grid)
    gradients = gradients_of(image, grid.cells.shape[:2], grid.stride)
    motion = camera_field(cells, np.ones(cells.sigma_px.shape), np.random.default_rng(0))
    seen = evidence(cells, motion, F, gradients)
    height, width = (-(-side // GRID) for side in grid.shape)
    displacement, static = np.zeros((height, width, 2)), np.ones((height, width), bool)
    valid = static.copy()
    if (truth := path.with_suffix(".npz")).exists():
        with np.load(truth) as stored:
            displacement, static, valid = stored["displacement"], stored["static"], stored["valid"]
    side = grid.stride // FINER // GRID
    predicted = np.kron(cells.displacement, np.ones((FINER * side, FINER * side, 1)))[:height, :width]
    error = np.minimum(*(np.linalg.norm(predicted - sign * displacement, axis=-1) for sign in (1, -1)))
    read = error < READ_PX + READ_SHARE * np.linalg.norm(displacement, axis=-1)
    weight = _shares(valid, side, seen.shape[:2])
    return Scene(
        evidence=seen.astype(np.float32),
        moving=_shares(~static, side, seen.shape[:2]),
        read=_shares(read & valid, side, seen.shape[:2]) / np.maximum(weight, 1e-6),
        weight=weight,
    )


def _shares(mask: NDArray[np.bool_], side: int, shape: tuple[int, ...]) -> Array:
    """Return the share of True in every square of ``side``; beyond the mask is False."""
    rows, columns = shape[0], shape[1]
    missing = [(0, n * side - have) for n, have in zip((rows, columns), mask.shape, strict=True)]
    return np.asarray(np.pad(mask, missing).reshape(rows, side, columns, side).mean((1, 3)))


def batch_of(
    scenes: list[Scene], mean: Array, scale: Array, rng: np.random.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Return evidence (N, K, h, w), questions (N, 2, h, w) and weights (N, h, w), turned and mirrored."""
    parts = []
    for one in scenes:
        stacked = np.dstack([(one.evidence - mean) / scale, one.moving, one.read, one.weight])
        for axis in (0, 1):
            stacked = np.flip(stacked, axis) if rng.random() < 0.5 else stacked
        parts.append(stacked.transpose(1, 0, 2) if rng.random() < 0.5 else stacked)
    size = np.max([part.shape[:2] for part in parts], axis=0)
    batch = np.zeros((len(parts), *size, parts[0].shape[2]), np.float32)
    for filled, part in zip(batch, parts, strict=True):
        missing = [(0, n - have) for n, have in zip(size, part.shape, strict=False)]
        filled[:] = np.pad(part, [*missing, (0, 0)], mode="edge")
        filled[part.shape[0] :, :, -1] = filled[:, part.shape[1] :, -1] = 0
    tensor = torch.from_numpy(batch).permute(0, 3, 1, 2)
    return tensor[:, :-3], tensor[:, -3:-1], tensor[:, -1]


def fit(scenes: list[Scene], seed: int) -> dict[str, Any]:
    """Return the coefficients, by the names that `classifier.Classifier.read` looks for."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    every = np.concatenate([one.evidence.reshape(-1, one.evidence.shape[-1]) for one in scenes])
    mean, scale = every.mean(axis=0), np.maximum(every.std(axis=0), 1e-3)
    network = Network(len(mean))
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY)
    batches = max(len(scenes) // BATCH, 1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=EPOCHS * batches)
    for epoch in range(EPOCHS):
        total, order = 0.0, rng.permutation(len(scenes))
        for chosen in np.array_split(order, batches):
            x, asked, weight = batch_of([scenes[k] for k in chosen], mean, scale, rng)
            loss = functional.binary_cross_entropy_with_logits(network(x), asked, reduction="none")
            mixed = ((loss[:, 0] + READ_WEIGHT * loss[:, 1]) * weight).sum() / weight.sum()
            optimizer.zero_grad()
            mixed.backward()
            optimizer.step()
            schedule.step()
            total += float(mixed.detach()) / batches
        print(f"epoch {epoch + 1}: {total:.4f}", flush=True)
    found: dict[str, Any] = {"mean": mean, "scale": scale}
    for k, layer in enumerate(network.layers):
        assert layer.bias is not None
        found |= {f"weight{k}": layer.weight.detach().numpy(), f"bias{k}": layer.bias.detach().numpy()}
    return found


def main() -> None:
    """Command line."""
    parser: argparse.ArgumentParser = parser_of(__doc__)
    parser.add_argument("scenes", type=existing, nargs="+", help="folders of photographs")
    parser.add_argument("--out", type=target, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cache", type=Path, help="folder that keeps smears and F for another training")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    network = SmearNetwork()
    names = [
        path
        for folder in arguments.scenes
        for path in sorted(folder.iterdir())
        if path.suffix in (".png", ".jpg") and not path.stem.endswith(("_open", "_close"))
    ]
    found = fit([scene_of(path, network, arguments.cache) for path in names], arguments.seed)
    command = f"python -m tools.training.train_movers {shlex.join(sys.argv[1:])}"
    np.savez(arguments.out, command=np.array(command), **found)


if __name__ == "__main__":
    main()
