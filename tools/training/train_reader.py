"""Train the spectral reader on the shards of tools.training.reader_data; a stopped run resumes.

::

    python -m tools.training.reader_data examples/train --photos FOLDER... --scenes render/train &
    python -m tools.training.reader_data examples/val --photos HELD... --first 900000 --shards 1
    python -m tools.training.train_reader --train examples/train --val examples/val --out runs/reader

Step k draws from the newest of the first ``12 + k / 40`` shards and waits until they are made: the two may
run beside each other, and what is learned depends on the seed alone.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from torch import Tensor
from torch.nn import functional as nnf

from blur2view.errors import ModelError
from blur2view.networks.spectra import PEAK_LAGS_PX
from blur2view.smears.likelihood import read_smears
from tools.metrics import DIRECTION_MIN_PX
from tools.training.pool import Batch, Pool, load_shard, octaves_of
from tools.training.reader import (
    Reader,
    ReaderOptions,
    box_sum,
    cross_entropy,
    kind_target,
    loss_of,
    radius_target,
    target_of,
)
from tools.training.reader_data import Example
from tools.training.run import TrainingRun
from tools.training.schedule import warm_cosine

WEIGHTS = "network."
"""Prefix of the names of the weights in an exported file."""
FIRST_SHARDS, STEPS_PER_SHARD = 12, 40
WARM_UP_STEPS = 200
LARGEST_GRADIENT = 1.0
COARSE_WEIGHT = 0.3
"""Weight of the smaller octaves' own losses."""
DIFFERING_WEIGHT, LEAST_DIFFERENCE_PX = 2.0, 2.0
"""Further weight of cells that differ wholly from those about them; and what of a difference is too small."""
BLUR_WEIGHT = 0.4
"""Weight of the losses of radii and of kinds."""
NEW_RATE = 8.0
"""Learning rate of what a file to start from does not hold, over that of the rest."""
LONGEST_PX = 60.0
"""Smears up to this length count in the figures: two octaves, which scenes have, read up to 76 px."""


@dataclass(frozen=True, kw_only=True)
class ReaderTraining:
    """One training run.

    Attributes
    ----------
    train, val, out : Path
        Folders of shards, of the shards that figures are of, and of checkpoint and log.
    weights : Path, optional
        An exported network, such as ``models/smear.onnx``, whose weights a fresh run starts from.
    steps, batch : int
        Optimiser steps, and pictures of 320x256 in each, or as many cells of larger ones.
    learning_rate : float
        Peak of a cosine (AdamW).
    shards, pool : int
        Shards that there will be, and how many are held in memory, the newest; 40 MB each.
    cepstra : {"both", "comb", "trend"}
        Which of the two cepstra of :mod:`tools.training.spectra` are shown, for ablations; else zeros.
    seed, threads : int
        Of weights and batches; threads of torch (two processes of one do more than one of two).
    save_every, validate_every : int
        Steps between checkpoints, and between figures.
    """

    train: Path
    val: Path
    out: Path
    weights: Path | None = None
    steps: int = 9000
    batch: int = 16
    learning_rate: float = 2e-3
    shards: int = 400
    pool: int = 100
    cepstra: str = "both"
    seed: int = 0
    threads: int = 1
    save_every: int = 100
    validate_every: int = 250

    def __post_init__(self) -> None:
        if self.cepstra not in ("both", "comb", "trend"):
            raise ValueError(f"expected cepstra both, comb or trend, got {self.cepstra}")


def showing(cepstra: str, row: Mapping[str, Any]) -> dict[str, Any]:
    """Return an example, or a batch, that shows only the comb's cepstrum, or only the trend's, or both."""
    hidden = {"comb": slice(len(PEAK_LAGS_PX), None), "trend": slice(len(PEAK_LAGS_PX))}
    shown = dict(row)
    if cepstra == "both":
        return shown
    for k in range(octaves_of(row)):
        shown[f"C{k}"] = shown[f"C{k}"] * 1  # a copy, of an array or a tensor
        shown[f"C{k}"][..., hidden[cepstra]] = 0
    return shown


def losses_of(network: Reader, batch: Batch, half: bool) -> tuple[list[Tensor], tuple[Tensor, ...]]:
    """Return the losses of the octaves, finest first, and the joint logits of the finest.

    In order: smears, radii, kinds. Losses of one octave are summed by their weights.
    """
    count = range(octaves_of(batch))
    with torch.autocast("cpu", dtype=torch.bfloat16, enabled=half):
        joint = network([(batch[f"C{k}"], batch[f"s{k}"]) for k in count])
    losses = []
    for k, (smears, radii, kinds) in enumerate(joint):
        d, r, shows = (batch[f"{key}{k}"] for key in "drt")
        target, weight = target_of(d, batch[f"v{k}"], smears.shape[-1])
        differing = 1 + DIFFERING_WEIGHT * difference_of(d)
        blur = cross_entropy(radii, radius_target(r, radii.shape[-1]), shows)
        blur = blur + cross_entropy(kinds, kind_target(d, r, shows), differing)
        losses.append(loss_of(smears, target, weight * differing) + BLUR_WEIGHT * blur)
    return losses, joint[0]


def difference_of(displacement: Tensor) -> Tensor:
    """Return how much cells of smears (N, h, w, S, 2) differ from the mean of 5 x 5 about them, 0 to 1."""
    z = torch.view_as_complex(displacement.contiguous())
    cell = torch.view_as_real(z * z / (z.abs() + 1e-6)).mean(-2)  # double angles: signs mean nothing
    around = box_sum(cell, 2) / box_sum(torch.ones_like(cell), 2)
    apart = torch.linalg.norm(cell - around, dim=-1)
    share: Tensor = apart / (torch.linalg.norm(around, dim=-1) + LEAST_DIFFERENCE_PX)
    return share.clamp(max=1)


@torch.no_grad()
def figures_of(network: Reader, shard: Example) -> dict[str, float]:
    """Return loss and errors, of all cells and of the certain half, on a shard's pictures."""
    network.eval()
    losses, smears, kinds, radii = [], [], [], []
    for first in range(0, len(shard["v0"]), 32):
        batch = {key: torch.from_numpy(array[first : first + 32]).float() for key, array in shard.items()}
        (loss, *_), (logits, sizes, kind) = losses_of(network, batch, half=False)
        losses.append(float(loss))
        right = kind_target(batch["d0"], batch["r0"], batch["t0"])
        kinds.append((right * nnf.one_hot(kind.argmax(-1), right.shape[-1])).sum(-1))
        out_of_focus = (right[..., 1] > 0.9) & (kind.argmax(-1) == 1)
        truth_bin = radius_target(batch["r0"], sizes.shape[-1]).argmax(-1)
        radii.append((sizes.argmax(-1) - truth_bin).abs()[out_of_focus].float())
        rows = read_smears(logits.flatten(0, 1).numpy())
        smears.append(rows.reshape(*logits.shape[:3], 4))
    network.train()
    read = np.concatenate(smears)
    truth = shard["d0"].astype(np.float32).mean(-2)
    length = np.hypot(truth[..., 0], truth[..., 1])
    keep = shard["v0"].min(-1) & (length >= DIRECTION_MIN_PX) & (length < LONGEST_PX)
    turn = np.arctan2(read[..., 1], read[..., 0]) - 2 * np.arctan2(truth[..., 1], truth[..., 0])
    error_deg = np.degrees(np.abs(np.angle(np.exp(1j * turn))))[keep] / 2
    ratio = np.log(np.hypot(read[..., 0], read[..., 1])[keep] / length[keep])
    certain = read[..., 3][keep] <= np.median(read[..., 3][keep])
    return {
        "loss": float(np.mean(losses)),
        "direction_deg": float(np.median(error_deg)),
        "direction_deg_top50": float(np.median(error_deg[certain])),
        "length_ratio": float(np.exp(np.median(ratio))),
        "length_spread": float(np.median(np.abs(ratio - np.median(ratio)))),
        "kinds_right": float(torch.cat(kinds).mean()),
        "radius_bins": float(torch.cat(radii).sum() / max(len(torch.cat(radii)), 1)),
    }


class Run(TrainingRun):
    """A training of the reader; `figures` are those of the last validation."""

    network: Reader
    average: Reader

    def __init__(self, options: ReaderTraining) -> None:
        torch.manual_seed(options.seed)
        self.options = options
        network, average = Reader(), Reader()
        held = exported_weights(options.weights) if options.weights else network.state_dict()
        missing = network.load_state_dict(held, strict=False).missing_keys
        average.load_state_dict(network.state_dict())
        named = dict(network.named_parameters())
        groups = [
            {"params": [each for name, each in named.items() if (name in missing) == new], "factor": factor}
            for new, factor in ((False, 1.0), (True, NEW_RATE))
        ]
        groups = [group for group in groups if group["params"]]
        optimiser = torch.optim.AdamW(groups, lr=options.learning_rate, weight_decay=1e-4)
        super().__init__(network=network, average=average, optimiser=optimiser)
        self.figures: dict[str, dict[str, float]] = {}
        if self.path.exists():
            self.figures = self.restore(self.path)["figures"]

    @property
    def path(self) -> Path:
        """The checkpoint."""
        return self.options.out / "last.pt"

    def save(self) -> None:
        """Write the checkpoint."""
        options = {name: str(v) if isinstance(v, Path) else v for name, v in asdict(self.options).items()}
        self.write(self.path, widths=self.network.options.as_dict(), figures=self.figures, options=options)

    def advance(self, batch: Batch) -> float:
        """Make one optimiser step; return the loss."""
        rate = warm_cosine(self.step, self.options.steps, self.options.learning_rate, WARM_UP_STEPS)
        (fine, *smaller), _ = losses_of(self.network, batch, half=True)
        self.descend(fine + COARSE_WEIGHT * torch.stack(smaller).sum(), rate, LARGEST_GRADIENT)
        return float(fine.detach())


def exported_weights(path: Path) -> dict[str, Tensor]:
    """Return the weights that `tools.training.export_reader` stored in a network file.

    Raises
    ------
    ModelError
        If the file holds none.
    """
    stored = [t for t in onnx.load(path).graph.initializer if t.name.startswith(WEIGHTS)]
    if not stored:
        raise ModelError(
            f"{path}: holds no weights to train on from; use a file of tools.training.export_reader"
        )
    return {
        t.name.removeprefix(WEIGHTS): torch.from_numpy(onnx.numpy_helper.to_array(t).copy()) for t in stored
    }


def load_average(checkpoint: Path) -> tuple[Reader, dict[str, Any]]:
    """Return the averaged network of a checkpoint, and all that the checkpoint says."""
    state: dict[str, Any] = torch.load(checkpoint, weights_only=True)
    network = Reader(ReaderOptions(**state["widths"]))
    network.load_state_dict(state["average"])
    return network.eval(), state


def train(options: ReaderTraining) -> Run:
    """Run the schedule to its end, printing figures and keeping ``out/last.pt`` fresh."""
    torch.set_num_threads(options.threads)
    options.out.mkdir(parents=True, exist_ok=True)
    paths = sorted(options.val.glob("*.npz"))
    held = {path.stem: showing(options.cepstra, load_shard(path)) for path in paths}
    run, pool, losses = Run(options), Pool(options.train, options.pool), []
    while run.step < options.steps:
        pool.grow_to(min(FIRST_SHARDS + run.step // STEPS_PER_SHARD, options.shards))
        rng = np.random.default_rng([options.seed, run.step])
        losses.append(run.advance(showing(options.cepstra, pool.batch(rng, options.batch))))
        done = run.step == options.steps
        if done or run.step % options.validate_every == 0:
            run.figures = {name: figures_of(run.average, shard) for name, shard in held.items()}
            report(run, float(np.mean(losses)))
            losses = []
        if done or run.step % options.save_every == 0:
            run.save()
    return run


def report(run: Run, loss: float) -> None:
    """Print one line and append it to the log: step, mean training loss since the line before, figures."""
    line = json.dumps({"step": run.step, "loss": round(loss, 4), **run.figures})
    print(line, flush=True)
    with (run.options.out / "log.jsonl").open("a") as file:
        file.write(line + "\n")


def parse() -> ReaderTraining:
    """Read the command line; the defaults are those of :class:`ReaderTraining`."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    for field in fields(ReaderTraining):
        name = f"--{field.name.replace('_', '-')}"
        if field.default is MISSING:
            parser.add_argument(name, type=Path, required=True)
        elif field.default is None:
            parser.add_argument(name, type=Path)
        else:
            kind = type(field.default)
            parser.add_argument(name, type=kind, default=field.default, help="(default: %(default)s)")
    return ReaderTraining(**vars(parser.parse_args()))


def main() -> None:
    """Train."""
    try:
        train(parse())
    except ModelError as error:
        raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main()
