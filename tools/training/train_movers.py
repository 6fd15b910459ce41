"""Fit the small network over places of the picture that finds movers: ``blur2view/segmentation/movers.npz``.

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

from __future__ import annotations

import argparse
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from blur2view.arrays import Array
from blur2view.networks.smear_network import SmearNetwork
from blur2view.photographs.image import read_image
from blur2view.pipeline import estimate
from blur2view.segmentation.camera_motion import Cells, camera_field
from blur2view.segmentation.decoder import Decoder
from blur2view.segmentation.evidence import FINER
from blur2view.segmentation.mask import places
from blur2view.segmentation.picture import QUARTER, SECTORS, Picture
from blur2view.smears.field import from_double_angle, to_double_angle, upsample_grid
from blur2view.smears.grid import SmearGrid
from tools.arguments import existing, parser_of, target
from tools.rendering.exposure import GRID
from tools.training.mover_network import CLASSES, Network, difference, smear_classes
from tools.training.mover_network import SECTORS as GUESSED_SECTORS

READ_PX, READ_SHARE = 2.0, 0.25  # error of a smear that is still read right: constant, and of its length
READ_WEIGHT, SMEAR_WEIGHT = 0.3, 0.4  # in the loss: whether a smear is read, and which it is
STEPS, BATCH, RATE, DECAY, WARM = 2200, 8, 3e-3, 2e-2, 100
CROP = 15, 20  # cells of a scene that a step looks at
LARGEST_DIFFERENCE = 1e-3  # between log-odds of NumPy and torch
ASKED = 3  # moving, read, valid: before the smear's classes


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Evidence (2h, 2w, K) of half cells and (4h, 4w, L) of quarters, and the truth (4h, 4w, 3 + CLASSES).

    The truth is the shares of a quarter that move, are read and are valid, and its smear's classes.
    """

    halves: NDArray[np.float16]
    quarters: NDArray[np.float16]
    truth: NDArray[np.float16]


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
    cells, shape = Cells.of(grid), grid.cells.shape[:2]
    motion = camera_field(cells, np.random.default_rng(0))
    halves, quarters = places(cells, motion, F, Picture.of(image, shape, grid.stride))
    truth = truth_of(path.with_suffix(".npz"), cells, motion, grid.stride)
    return Scene(halves=halves.astype(np.float16), quarters=quarters.astype(np.float16), truth=truth)


def truth_of(path: Path, cells: Cells, motion: Array, stride: int) -> NDArray[np.float16]:
    """Return what moves, is read and is valid of every quarter of a cell, and the classes of its smear."""
    height, width = (-(-side // GRID) for side in cells.shape)
    displacement, static = np.zeros((height, width, 2)), np.ones((height, width), bool)
    valid = static.copy()
    if path.exists():
        with np.load(path) as stored:
            displacement, static, valid = stored["displacement"], stored["static"], stored["valid"]
    side = stride // QUARTER // GRID
    shape = QUARTER * motion.shape[0], QUARTER * motion.shape[1]
    weight = _shares(valid, side, shape)
    moving = np.minimum(_shares(~static & valid, side, shape) / np.maximum(weight, 1e-6), 1)
    missing = [(0, n * side - have) for n, have in zip(shape, valid.shape, strict=True)]
    known = np.pad(np.where(valid[..., None], displacement, 0), [*missing, (0, 0)])[::side, ::side]
    seen = cells.displacement.repeat(QUARTER, axis=0).repeat(QUARTER, axis=1)
    error = np.minimum(*(np.linalg.norm(seen - sign * known, axis=-1) for sign in (1, -1)))
    read = error < READ_PX + READ_SHARE * np.linalg.norm(known, axis=-1)
    fine = upsample_grid(to_double_angle(motion).astype(np.float32), QUARTER)
    classes = smear_classes(known, from_double_angle(fine))
    return np.dstack([moving, read, weight, classes]).astype(np.float16)


def _shares(mask: NDArray[np.bool_], side: int, shape: tuple[int, int]) -> Array:
    """Return the share of True in every square of ``side``; beyond the mask is False."""
    missing = [(0, n * side - have) for n, have in zip(shape, mask.shape, strict=True)]
    return np.asarray(np.pad(mask, missing).reshape(shape[0], side, shape[1], side).mean((1, 3)))


def mirrored(scene: list[NDArray[np.float16]]) -> list[NDArray[np.float16]]:
    """Return evidence and truth, turned over already, with their directions turned over, too."""
    halves, quarters, truth = scene
    spectra = halves.shape[-1] - 8 * (SECTORS + 1)
    other = np.append(-np.arange(SECTORS) % SECTORS, SECTORS)
    rings = spectra + np.arange(8 * (SECTORS + 1)).reshape(8, -1)[:, other].ravel()
    classes = np.arange(CLASSES - 1).reshape(-1, GUESSED_SECTORS)[
        :, -np.arange(GUESSED_SECTORS) % GUESSED_SECTORS
    ]
    kept = np.arange(ASKED + 1)
    return [
        halves[..., np.concatenate([np.arange(spectra), rings])],
        quarters,
        truth[..., np.concatenate([kept, ASKED + 1 + classes.ravel()])],
    ]


def batch_of(scenes: list[Scene], rng: np.random.Generator) -> list[Tensor]:
    """Return evidence (N, K, 2h, 2w), (N, L, 4h, 4w) and truth (N, 3 + CLASSES, 4h, 4w) of turned crops."""
    swapped, batch = rng.random() < 0.5, []
    for one in scenes:
        parts = _crop([one.halves, one.quarters, one.truth], rng)
        flips = rng.random(2) < 0.5
        for axis in np.flatnonzero(flips).tolist():
            parts = [np.flip(part, axis) for part in parts]
        parts = [part.transpose(1, 0, 2) for part in parts] if swapped else parts
        batch.append(mirrored(parts) if (flips.sum() + swapped) % 2 else parts)
    return [
        torch.from_numpy(np.stack(each).astype(np.float32)).permute(0, 3, 1, 2)
        for each in zip(*batch, strict=True)
    ]


def _crop(parts: list[NDArray[np.float16]], rng: np.random.Generator) -> list[NDArray[np.float16]]:
    """Cut as many cells; what a scene has too few of is repeated and counts nothing."""
    have = [side // FINER for side in parts[0].shape[:2]]
    top, left = (int(rng.integers(max(n - most, 0) + 1)) for n, most in zip(have, CROP, strict=True))
    cut = []
    for part, side in zip(parts, (FINER, QUARTER, QUARTER), strict=True):
        part = part[side * top : side * (top + CROP[0]), side * left : side * (left + CROP[1])]
        missing = [(0, side * most - n) for n, most in zip(part.shape, CROP, strict=False)]
        rows, columns = part.shape[:2]
        cut.append(np.pad(part, [*missing, (0, 0)], mode="edge"))
    cut[-1][rows:, :, ASKED - 1] = cut[-1][:, columns:, ASKED - 1] = 0
    return cut


def loss_of(network: Network, batch: list[Tensor]) -> Tensor:
    """Return the mixed cross-entropies of moving, of read, and of the smear's classes."""
    found, smear = network(*batch[:2])
    truth, weight = batch[2], batch[2][:, ASKED - 1]
    asked = functional.binary_cross_entropy_with_logits(found, truth[:, :2], reduction="none")
    guessed = -(torch.log_softmax(smear, 1) * truth[:, ASKED:]).sum(1)
    mixed = asked[:, 0] + READ_WEIGHT * asked[:, 1] + SMEAR_WEIGHT * guessed
    return (mixed * weight).sum() / weight.sum()


def standard(layers: list[NDArray[np.float16]]) -> tuple[Array, Array]:
    """Return means and deviations (K,) of evidence (h, w, K) of scenes."""
    every = np.concatenate([layer.reshape(-1, layer.shape[-1])[::11].astype(float) for layer in layers])
    return every.mean(axis=0), np.maximum(every.std(axis=0), 1e-2)


def fit(scenes: list[Scene], seed: int, steps: int = STEPS) -> Network:
    """Return the fitted network."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    standards = [standard([getattr(one, grid) for one in scenes[::4]]) for grid in ("halves", "quarters")]
    network = Network(standards, scenes[0].halves.shape[-1] - 8 * (SECTORS + 1))
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY)
    order: list[int] = []
    for step in range(steps):
        if len(order) < BATCH:
            order = rng.permutation(len(scenes)).tolist()
        chosen, order = order[:BATCH], order[BATCH:]
        for group in optimizer.param_groups:
            group["lr"] = RATE * min(1, (step + 1) / WARM) * (0.5 + 0.5 * np.cos(np.pi * step / steps))
        loss = loss_of(network, batch_of([scenes[k] for k in chosen], rng))
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        if step % 100 == 99:
            print(f"step {step + 1}: {loss.item():.4f}", flush=True)
    return network


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
    scenes = [scene_of(path, network, arguments.cache) for path in names]
    found = fit(scenes, arguments.seed)
    command = f"python -m tools.training.train_movers {shlex.join(sys.argv[1:])}"
    np.savez(arguments.out, command=np.array(command), **found.coefficients())
    halves, quarters = (layer.astype(np.float32) for layer in (scenes[0].halves, scenes[0].quarters))
    if difference(found, Decoder.read(arguments.out), halves, quarters) > LARGEST_DIFFERENCE:
        raise SystemExit(f"{arguments.out} differs from torch")


if __name__ == "__main__":
    main()
