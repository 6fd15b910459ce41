"""Train the mover network on the shards of `tools.training.mover_data`; stopped, it goes on where it was.

``python -m tools.training.train_movers EXAMPLES --out runs/movers --steps 9000`` writes ``last.pt`` every two
hundred steps, and every ``--validate`` steps the average precision by kind of picture on ``--held``: shards
of photographs and scenes that train nothing. Shards that are added meanwhile are taken up.
"""

import argparse
import copy
import time
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from blur2view.movers.inputs import OCTAVES
from tools.arguments import existing, parser_of
from tools.evaluation.segmentation import average_precision
from tools.training.movers import Movers
from tools.training.run import TrainingRun
from tools.training.schedule import warm_cosine

BATCH = 8
RATE, WARM_UP, DECAY = 3e-3, 200, 1e-4
READ_WEIGHT = 0.2
"""Of the second question, whether a smear is read, in the loss."""
LUMA = 4 * OCTAVES
"""First of the three channels of places that are colours."""
F_CHANNELS = (4, 5, 10)
"""Channels of cells that F makes."""
NO_F_SHARE = 0.1
"""Share of pictures whose F is hidden."""
LARGEST_GRADIENT = 2.0
SAVED = 200
"""Steps between two checkpoints."""
READ_AT_ONCE = 12
"""Shards that a batch is drawn from; one of them is replaced every other step."""

Batch = tuple[Tensor, Tensor, Tensor, Tensor]


def load(path: Path) -> dict[str, np.ndarray]:
    """Return a shard."""
    with np.load(path) as file:
        return {key: file[key] for key in file.files}


def batch_of(shards: list[dict[str, np.ndarray]], rng: np.random.Generator) -> Batch:
    """Draw pictures, turned and mirrored: places, cells, moving and read.

    Moving (N, 8 h, 8 w) is below 0 where it is unknown.
    """
    rows = []
    for _ in range(BATCH):
        shard = shards[int(rng.integers(len(shards)))]
        k = int(rng.integers(len(shard["moving"])))
        rows.append([np.asarray(shard[key][k], np.float32) for key in ("places", "cells", "moving", "read")])
    axes = [axis for axis in (0, 1) if rng.random() < 0.5]
    turned = rng.random() < 0.5
    tensors = []
    for part in zip(*rows, strict=True):
        stacked = np.flip(np.stack(part), tuple(1 + axis for axis in axes))
        stacked = stacked.swapaxes(1, 2) if turned else stacked
        tensors.append(torch.from_numpy(np.ascontiguousarray(stacked)))
    places, cells, moving, read = tensors
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


@torch.no_grad()
def validated(network: nn.Module, paths: list[Path]) -> str:
    """Return average precisions by kind of picture, and false area at 0.5 where nothing moves."""
    network.eval()
    figures: dict[str, list[float]] = {}
    for path in paths:
        shard = load(path)
        for k, kind in enumerate(shard["kind"]):
            places, cells = (torch.from_numpy(shard[key][k : k + 1].astype(np.float32)).permute(0, 3, 1, 2)
                             for key in ("places", "cells"))  # fmt: skip
            score = network(places, cells)[0, 0].numpy()
            truth = shard["moving"][k].astype(np.float32)
            known, moves = truth >= 0, truth > 0.5
            if moves.any():
                figures.setdefault(f"{kind} AP", []).append(average_precision(score[known], moves[known]))
            else:
                figures.setdefault(f"{kind} false", []).append(float((score > 0)[known].mean()))
    return ", ".join(
        f"{name} {np.mean(values):.3f} ({len(values)})" for name, values in sorted(figures.items())
    )


def main() -> None:
    """Command line."""
    parser: argparse.ArgumentParser = parser_of(__doc__)
    parser.add_argument("examples", type=existing)
    parser.add_argument("--held", type=existing)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=9000)
    parser.add_argument("--validate", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(arguments.seed)
    network = Movers()
    run = TrainingRun(
        network=network,
        average=copy.deepcopy(network),
        optimiser=torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY),
    )
    shards = [load(path) for path in sorted(arguments.examples.glob("*.npz"))[:READ_AT_ONCE]]
    checkpoint = arguments.out / "last.pt"
    if checkpoint.exists():
        run.restore(checkpoint)
    else:
        for key, norm in (("places", network.of_places), ("cells", network.of_cells)):
            every = np.concatenate([shard[key] for shard in shards]).astype(np.float32)
            norm.learn(torch.from_numpy(every).permute(0, 3, 1, 2))
        run.average.load_state_dict(network.state_dict())
    rng = np.random.default_rng([arguments.seed, run.step])
    mean, began = 0.0, time.perf_counter()
    while run.step < arguments.steps:
        network.train()
        places, cells, moving, read = batch_of(shards, rng)
        rate = warm_cosine(run.step, arguments.steps, RATE, WARM_UP)
        loss = run.descend(loss_of(network(places, cells), moving, read), rate, LARGEST_GRADIENT)
        mean += 0.01 * (loss - mean) if mean else loss
        if run.step % 2 == 0:
            paths = sorted(arguments.examples.glob("*.npz"))
            shards[int(rng.integers(len(shards)))] = load(paths[int(rng.integers(len(paths)))])
        if run.step % SAVED == 0:
            run.write(checkpoint, batch=BATCH, seed=arguments.seed)
            print(f"{run.step}: {mean:.4f}, {time.perf_counter() - began:.0f} s", flush=True)
        if arguments.held and run.step % arguments.validate == 0:
            print(validated(run.average, sorted(arguments.held.glob("*.npz"))), flush=True)
    run.write(checkpoint, batch=BATCH, seed=arguments.seed)


if __name__ == "__main__":
    main()
