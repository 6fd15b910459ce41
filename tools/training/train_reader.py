"""Train the spectral reader on the shards of tools.training.reader_data; a stopped run resumes.

::

    python -m tools.training.reader_data examples/train --photos FOLDER...
    python -m tools.training.reader_data examples/val --photos HELD... --first 900000 --shards 1
    python -m tools.training.train_reader --train examples/train --val examples/val --out runs/reader

``--weights`` starts a fresh run from an exported network, such as ``models/smear.onnx``. A batch is of one
shard: so many pictures of 320x256, or as many cells of larger ones.
"""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
import onnx
import torch
from torch import Tensor
from torch.nn import functional as nnf

from blur2view.errors import ModelError
from blur2view.smears.grid import from_double_angle
from blur2view.smears.likelihood import read_smears
from tools.command import Existing, run
from tools.datasets.shards import Example, load_shard, load_shards
from tools.evaluation.evaluate import Smears, smear_figures
from tools.metrics import DIRECTION_MIN_PX
from tools.training.reader import Circular, Reader, cross_entropy, kind_target, radius_target, target_of
from tools.training.run import Schedule, Task, fit

WEIGHTS = "network."
"""Prefix of the names of the weights in an exported file."""
ROUNDED_PARTS = "quantized", "scale", "zero_point"
"""What an exported file holds of a matrix that ONNX Runtime rounded to integers."""
PICTURE_CELLS = 80
"""Cells of a picture of 320x256, which sizes of batches are counted in."""
COARSE_WEIGHT = 0.3
"""Weight of the smaller octaves' own losses."""
BLUR_WEIGHT = 0.4
"""Weight of the losses of radii and of kinds."""
LONGEST_PX = 60.0
"""Smears up to this length count in the figures: two octaves, which scenes have, read up to 76 px."""
FIGURES = "direction_deg", "direction_deg_top50", "length_ratio", "length_spread"

Batch = Mapping[str, Tensor]


class ReaderTask(Task):
    """The reader, and the shards that it learns from and that figures are of."""

    network: Reader

    def __init__(self, train: Path, held: Path, weights: Path | None, batch: int, seed: int) -> None:
        network = Reader()
        facts = {"batch": batch, "seed": seed, "train": str(train), "weights": str(weights)}
        super().__init__(network, {"widths": asdict(network.options), **facts})
        self.batch, self.train = batch, sorted(train.glob("*.npz"))
        self.held = load_shards(held)
        if weights is not None:
            network.load_state_dict(exported_weights(weights, network))

    def loss(self, rng: np.random.Generator, step: int) -> Tensor:
        """Return the loss of all octaves of a batch."""
        shard = load_shard(self.train[int(rng.integers(len(self.train)))])
        (fine, *smaller), _ = losses_of(self.network, batch_of(shard, rng, self.batch), half=True)
        return fine + COARSE_WEIGHT * torch.stack(smaller).sum()

    def figures(self, network: torch.nn.Module) -> dict[str, dict[str, float]]:
        """Return the figures of every shard that trains nothing."""
        assert isinstance(network, Reader)
        return {str(k): figures_of(network, shard) for k, shard in enumerate(self.held)}


def batch_of(shard: Example, rng: np.random.Generator, count: int) -> Batch:
    """Return random examples of a shard: `count`, or as many cells in larger ones."""
    pictures, cells = len(shard["v0"]), int(np.prod(shard["v0"].shape[1:3]))
    chosen = rng.integers(pictures, size=max(1, count * PICTURE_CELLS // cells))
    return {name: torch.from_numpy(array[chosen]).float() for name, array in shard.items()}


def losses_of(network: Reader, batch: Batch, half: bool) -> tuple[list[Tensor], tuple[Tensor, ...]]:
    """Return the losses of the octaves, finest first, and the joint logits of the finest.

    In order: smears, radii, kinds. Losses of one octave are summed by their weights.
    """
    count = range(sum(key.startswith("v") for key in batch))
    with torch.autocast("cpu", dtype=torch.bfloat16, enabled=half):
        joint = network([(batch[f"C{k}"], batch[f"s{k}"]) for k in count])
    losses = []
    for k, (smears, radii, kinds) in enumerate(joint):
        d, r, shows = (batch[f"{key}{k}"] for key in "drt")
        target, weight = target_of(d, batch[f"v{k}"], smears.shape[-1])
        blur = cross_entropy(radii, radius_target(r, radii.shape[-1]), shows)
        blur = blur + cross_entropy(kinds, kind_target(d, r, shows), torch.ones_like(weight))
        losses.append(cross_entropy(smears, target, weight, axes=2) + BLUR_WEIGHT * blur)
    return losses, joint[0]


@torch.no_grad()
def figures_of(network: Reader, shard: Example) -> dict[str, float]:
    """Return the loss and the errors of smears, of all cells and of the certain half, on a shard."""
    losses, smears, kinds = [], [], []
    for first in range(0, len(shard["v0"]), 32):
        batch = {key: torch.from_numpy(array[first : first + 32]).float() for key, array in shard.items()}
        (loss, *_), (logits, _, kind) = losses_of(network, batch, half=False)
        losses.append(float(loss))
        right = kind_target(batch["d0"], batch["r0"], batch["t0"])
        kinds.append((right * nnf.one_hot(kind.argmax(-1), right.shape[-1])).sum(-1))
        smears.append(read_smears(logits.flatten(0, 1).numpy()).reshape(*logits.shape[:3], 4))
    true = shard["d0"].astype(np.float32).mean(-2)
    length = np.hypot(true[..., 0], true[..., 1])
    keep = shard["v0"].min(-1) & (length >= DIRECTION_MIN_PX) & (length < LONGEST_PX)
    read, true = np.concatenate(smears)[keep], true[keep]
    sure = read[:, 3] <= np.median(read[:, 3])
    every = Smears(found=from_double_angle(read[:, :2]), true=true, sigma=read[:, 2], sure=sure)
    figures = {name: figure for name, figure in smear_figures(every).items() if name in FIGURES}
    return {"loss": float(np.mean(losses)), **figures, "kinds_right": float(torch.cat(kinds).mean())}


def exported_weights(path: Path, network: Reader) -> dict[str, Tensor]:
    """Return the weights that `tools.training.export` stored; ModelError if a file holds none.

    What it rounded to 8 bits is rounded still.
    """
    stored = {
        tensor.name.removeprefix(WEIGHTS): torch.from_numpy(onnx.numpy_helper.to_array(tensor).copy())
        for tensor in onnx.load(path).graph.initializer
        if tensor.name.startswith(WEIGHTS)
    }
    if not stored:
        raise ModelError(f"{path}: holds no weights to train on from; use a file of tools.training.export")
    for name, layer in network.named_modules():
        if isinstance(layer, Circular) and f"{name}.matrix_quantized" in stored:
            whole, scale, _ = (stored.pop(f"{name}.matrix_{part}") for part in ROUNDED_PARTS)
            stored[f"{name}.weight"] = layer.weight_of(whole * scale)
    return stored


def main(
    *,
    train: Existing,
    val: Existing,
    out: Path,
    weights: Existing | None = None,
    steps: int = 9000,
    batch: int = 16,
    rate: float = 2e-3,
    seed: int = 0,
    every: int = 250,
) -> None:
    """Train by one thread: two processes do more than two threads."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    try:
        task = ReaderTask(train, val, weights, batch, seed)
    except ModelError as error:
        raise SystemExit(str(error)) from None
    fit(task, Schedule(out=out, steps=steps, rate=rate, largest_gradient=1.0, seed=seed, every=every))


if __name__ == "__main__":
    run(main)
