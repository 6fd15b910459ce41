"""Train the network that sees blur against the camera's motion, on scenes that are drawn first.

``python -m tools.training.train_movers PHOTOGRAPHS --out runs/movers`` draws scenes of layers as
`tools.training.train_unet` does, measures them as the package does, writes them to ``examples`` and ``held``
in shards of 16 pictures (9 MB), and trains on the processor; ``last.pt`` is what
`tools.training.export_movers` exports. Stopped, it goes on. ``--shards 1 --held 1 --steps 2`` tries it.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from blur2view.movers.blur_evidence import OCTAVES, Picture, of_cells, of_places
from blur2view.movers.camera_motion import Cells, camera_field
from blur2view.movers.moving import LEFT, at_cells
from blur2view.networks.smear_network import SmearNetwork, rgb_of
from blur2view.networks.spectra import STEP
from tools.arguments import Existing, run
from tools.datasets.shards import Example, load_shard, load_shards, write_shards
from tools.metrics import epe_s
from tools.rendering.layer_scenes import KINDS, PLACE_PX, Sources
from tools.training.movers import Movers
from tools.training.run import Schedule, Task, batched, fit
from tools.training.train_unet import judged, means, photographed, split_sources

SIZE, PICTURES = (640, 480), 16
"""Of a picture; in a shard."""
BATCH, RATE = 8, 3e-3
READ_WEIGHT = 0.2
"""Of the second question, whether a smear is read, in the loss."""
READ_PX, READ_SHARE = 2.0, 0.25
"""Error of a smear that is still read right: constant, and of its length."""
LEFT_OUT_SHARE = 0.5
"""Share of pictures whose camera motion is fitted with the movers left out, as where the U-Net sees them."""
LUMA = 4 * OCTAVES
"""First of the three channels of places that are colours."""
NORM_SHARDS = 12
"""Shards that means and deviations of the inputs are taken from."""


def example(
    rng: np.random.Generator, sources: Sources, size: tuple[int, int], network: SmearNetwork
) -> Example:
    """Return what the network sees of a scene, the share of each place that moves, and whether it is read."""
    scene, image = photographed(rng, sources, size)
    grid = network.predict(image)
    cells, shape = Cells.of(grid), grid.cells.shape[:2]
    moves = at_cells(np.clip(scene.moving, 0, 1), shape)
    left_out = (1 - LEFT) * (rng.random() < LEFT_OUT_SHARE)
    motion = camera_field(cells, 1 - left_out * moves, rng)
    picture = Picture(rgb_of(image), (shape[0], shape[1]), grid.stride)
    side = STEP // PLACE_PX
    error = epe_s(np.kron(cells.displacement, np.ones((side, side, 1))), scene.displacement)
    return {
        "places": np.moveaxis(of_places(picture, cells, motion), -1, 0).astype(np.float16),
        "cells": np.moveaxis(of_cells(cells, grid, motion), -1, 0).astype(np.float16),
        "moving": np.clip(scene.moving, 0, 1).astype(np.float16),
        "read": error < READ_PX + READ_SHARE * np.linalg.norm(scene.displacement, axis=-1),
        "kind": np.array(KINDS.index(scene.kind)),
    }


def examples(
    number: int, *, seed: int, sources: Sources, size: tuple[int, int] = SIZE, count: int = PICTURES
) -> Iterator[Example]:
    """Yield the examples of a shard, which depend on the seed, its number and the sources."""
    rng, network = np.random.default_rng([seed, number]), SmearNetwork(threads=1)
    return (example(rng, sources, size, network) for _ in range(count))


class MoverTask(Task):
    """The network, the shards it learns from, and those it is judged on."""

    def __init__(self, train: Path, held: Path, seed: int) -> None:
        network = Movers()
        super().__init__(network, {"batch": BATCH, "seed": seed})
        self.train, self.held = sorted(train.glob("*.npz")), load_shards(held)
        shards = [load_shard(path) for path in self.train[:NORM_SHARDS]]
        for key, norm in (("places", network.of_places), ("cells", network.of_cells)):
            norm.learn(torch.from_numpy(np.concatenate([shard[key] for shard in shards]).astype(np.float32)))

    def loss(self, rng: np.random.Generator, step: int) -> Tensor:
        """Return the loss of pictures of one shard."""
        batch = batch_of(load_shard(self.train[int(rng.integers(len(self.train)))]), rng)
        return loss_of(self.network(batch["places"], batch["cells"]), batch)

    @torch.no_grad()
    def figures(self, network: nn.Module) -> dict[str, float]:
        """Return average precision by kind, and false area where nothing moves."""
        rows = []
        for shard in self.held:
            for k in range(len(shard["kind"])):
                one = {name: array[k] for name, array in shard.items()}
                batch = batched([one])
                rows.append(judged(network(batch["places"], batch["cells"])[0, 0].numpy(), one))
        return means(rows)


def batch_of(shard: Example, rng: np.random.Generator) -> dict[str, Tensor]:
    """Draw pictures of a shard, mirrored, turned and brightened."""
    chosen = rng.permutation(len(shard["kind"]))[:BATCH]
    batch = batched([{name: array[k] for name, array in shard.items() if name != "kind"} for k in chosen])
    axes = [axis for axis in (-2, -1) if rng.random() < 0.5]
    batch = {name: part.flip(axes) for name, part in batch.items()}
    if rng.random() < 0.5:
        batch = {name: part.transpose(-2, -1) for name, part in batch.items()}
    gains = rng.uniform((0.5, -1.2, -1.2), (1.3, 1.2, 1.2), (len(chosen), 3)).astype(np.float32)
    batch["places"][:, LUMA:] *= torch.from_numpy(gains)[..., None, None]
    return batch


def loss_of(odds: Tensor, batch: dict[str, Tensor]) -> Tensor:
    """Return the mean cross-entropy of both questions."""
    moves, reads = (
        nnf.binary_cross_entropy_with_logits(odds[:, k], batch[name])
        for k, name in enumerate(("moving", "read"))
    )
    return moves + READ_WEIGHT * reads


def main(
    photographs: list[Existing],
    *,
    out: Path,
    things: Existing | None = None,
    shards: int = 260,
    held: int = 3,
    steps: int = 12000,
    seed: int = 0,
) -> None:
    """Draw shards of folders of photographs, of emoji and cut-outs of a folder, and train on them."""
    sources, kept = split_sources(photographs, things)
    write_shards(out / "examples", range(shards), partial(examples, seed=seed, sources=sources))
    write_shards(out / "held", range(held), partial(examples, seed=seed + 1, sources=kept))
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    schedule = Schedule(
        out=out, steps=steps, rate=RATE, largest_gradient=2.0, seed=seed, save_every=200, validate_every=1000
    )
    fit(MoverTask(out / "examples", out / "held", seed), schedule)


if __name__ == "__main__":
    run(main)
