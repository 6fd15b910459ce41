"""Train the mover network on the shards of `tools.training.mover_data`; stopped, it goes on where it was.

``python -m tools.training.train_movers EXAMPLES --out runs/movers --steps 9000`` writes ``last.pt`` every two
hundred steps, and every ``--validate`` steps the average precision by kind of picture on ``--held``: shards
of photographs and scenes that train nothing. Shards that are added meanwhile are taken up.
"""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from blur2view.movers.inputs import OCTAVES
from tools.arguments import Existing, run
from tools.datasets.shards import Example, load_shard
from tools.metrics import average_precision
from tools.training.movers import Movers
from tools.training.run import Schedule, Task, batched, drawn, fit

BATCH, RATE = 8, 3e-3
READ_WEIGHT = 0.2
"""Of the second question, whether a smear is read, in the loss."""
LUMA = 4 * OCTAVES
"""First of the three channels of places that are colours."""
F_CHANNELS = (4, 5, 10)
"""Channels of cells that F makes."""
NO_F_SHARE = 0.1
"""Share of pictures whose F is hidden."""
READ_AT_ONCE = 12
"""Shards that a batch is drawn from; one of them is replaced every other step."""


class MoverTask(Task):
    """The mover network, and the folders of examples that it learns from and is judged on."""

    def __init__(self, examples: Path, held: Path | None, seed: int) -> None:
        network = Movers()
        super().__init__(network, {"batch": BATCH, "seed": seed})
        self.examples = examples
        self.held = sorted(held.glob("*.npz")) if held else []
        self.shards = [load_shard(path) for path in sorted(examples.glob("*.npz"))[:READ_AT_ONCE]]
        for key, norm in (("places", network.of_places), ("cells", network.of_cells)):
            every = np.concatenate([shard[key] for shard in self.shards]).astype(np.float32)
            norm.learn(torch.from_numpy(every).permute(0, 3, 1, 2))

    def loss(self, rng: np.random.Generator, step: int) -> Tensor:
        """Return the loss of a batch; every other time a shard is replaced first."""
        if step % 2 == 0:
            paths = sorted(self.examples.glob("*.npz"))
            self.shards[int(rng.integers(len(self.shards)))] = load_shard(
                paths[int(rng.integers(len(paths)))]
            )
        places, cells, moving, read = batch_of(self.shards, rng)
        return loss_of(self.network(places, cells), moving, read)

    @torch.no_grad()
    def figures(self, network: nn.Module) -> dict[str, float]:
        """Return mean average precisions by kind of picture, and false areas at 0.5 where nothing moves."""
        found: dict[str, list[float]] = {}
        for shard in map(load_shard, self.held):
            for k, kind in enumerate(shard.pop("kind")):
                one = batched([{key: array[k] for key, array in shard.items()}])
                places, cells = (one[key].permute(0, 3, 1, 2) for key in ("places", "cells"))
                score, truth = network(places, cells)[0, 0].numpy(), one["moving"][0].numpy()
                known, moves = truth >= 0, truth > 0.5
                if moves.any():
                    found.setdefault(f"{kind} AP", []).append(average_precision(score[known], moves[known]))
                else:
                    found.setdefault(f"{kind} false", []).append(float((score > 0)[known].mean()))
        return {name: round(float(np.mean(values)), 3) for name, values in sorted(found.items())}


def batch_of(shards: list[Example], rng: np.random.Generator) -> tuple[Tensor, ...]:
    """Draw pictures, turned and mirrored: places, cells, moving and read.

    Moving (N, 8 h, 8 w) is below 0 where it is unknown.
    """
    rows = [drawn(shards, rng) for _ in range(BATCH)]
    one = batched([{key: row[key] for key in ("places", "cells", "moving", "read")} for row in rows])
    axes = [1 + axis for axis in (0, 1) if rng.random() < 0.5]
    parts = [part.flip(axes) for part in one.values()]
    if rng.random() < 0.5:
        parts = [part.transpose(1, 2) for part in parts]
    places, cells, moving, read = parts
    gains = torch.from_numpy(rng.uniform((0.5, -1.2, -1.2), (1.3, 1.2, 1.2), (BATCH, 3)).astype(np.float32))
    places[..., LUMA:] *= gains[:, None, None]
    hidden = torch.from_numpy(rng.random(BATCH) < NO_F_SHARE)
    for channel in F_CHANNELS:
        cells[hidden, ..., channel] = 0
    return places.permute(0, 3, 1, 2), cells.permute(0, 3, 1, 2), moving, read


def loss_of(odds: Tensor, moving: Tensor, read: Tensor) -> Tensor:
    """Return the mean cross-entropy of both questions where the truth is known."""
    known = (moving >= 0).float()
    losses = (
        functional.binary_cross_entropy_with_logits(answer, truth.clamp(0, 1), reduction="none")
        for answer, truth in ((odds[:, 0], moving), (odds[:, 1], read))
    )
    moves, reads = ((loss * known).sum() / known.sum() for loss in losses)
    total: Tensor = moves + READ_WEIGHT * reads
    return total


def main(
    examples: Existing,
    *,
    held: Existing | None = None,
    out: Path,
    steps: int = 9000,
    validate: int = 1000,
    seed: int = 0,
) -> None:
    """Train."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    schedule = Schedule(
        out=out, steps=steps, rate=RATE, largest_gradient=2.0, seed=seed, save_every=200,
        validate_every=validate,
    )  # fmt: skip
    fit(MoverTask(examples, held, seed), schedule)


if __name__ == "__main__":
    run(main)
