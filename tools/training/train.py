r"""Train the smear network on rendered scenes, on a CPU or a GPU; a stopped run resumes.

From nothing to a checkpoint::

    python -m tools.datasets.shards --out render/train --scenes 5250 --photos KODAK
    python -m tools.datasets.shards --out render/val --scenes 100 --first-seed 900000 --split test \
        --photos KODAK
    python -m tools.training.train --train render/train --val render/val --out runs/smear --steps 6500 \
        --processes 2

``models/README.md`` has the whole recipe of the shipped network. Run the last line again to go on from
``runs/smear/last.pt``. The loss is in :mod:`tools.training.loss`, the figures that are printed on the way in
:mod:`tools.training.validation`.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator
from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path

import cv2
import numpy as np
import torch
import torch.multiprocessing
from torch import Tensor, distributed
from torch.utils.data import DataLoader

from blur2view.errors import Blur2ViewError
from tools.datasets.shards import Scenes, load_shards, require_shards
from tools.training.checkpoint import Run, follow, start_run
from tools.training.crops import CropStream
from tools.training.loss import Loss, loss_of
from tools.training.model import MULTIPLE_OF, SmearUNet
from tools.training.schedule import warm_cosine
from tools.training.validation import figures_of, predict, validation_crops

WARM_UP_STEPS = 300
RANK_SEED = 1_000_003
"""Added to the crops' seed for each further training process."""


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """One training run.

    Attributes
    ----------
    train, val, out : Path
        Folders of rendered shards, and of checkpoints and the log.
    weights : Path, optional
        A checkpoint whose averaged weights a fresh run starts from, such as ``models/smear.pt``.
    steps : int
        Length of the whole run; the learning rate falls to 1 % of its peak over it along a cosine.
    batch, side : int
        Crops a step and their side in pixels (a multiple of 16).
    learning_rate : float
        Peak of the schedule (AdamW).
    alpha : float
        The paper's bound on 1 / sigma^2 where the cross-check fails.
    seed : int
        Decides the initial weights and every crop.
    processes : int
        Training processes, one batch each a step, whose gradients are averaged; on a CPU two processes of one
        thread do more than one of two threads. The result depends on their number.
    workers : int
        Processes that make crops, for each training process; with 0 the training process makes them itself.
    save_every, validate_every : int
        Steps between checkpoints and between validations.

    Raises
    ------
    ValueError
        If `side` is not a positive multiple of 16.
    """

    train: Path
    val: Path
    out: Path
    weights: Path | None = None
    steps: int = 30000
    batch: int = 12
    side: int = 192
    learning_rate: float = 2e-3
    alpha: float = 0.01
    seed: int = 0
    processes: int = 1
    workers: int = 1
    save_every: int = 250
    validate_every: int = 500

    def __post_init__(self) -> None:
        """Check the size of crops."""
        if self.side <= 0 or self.side % MULTIPLE_OF:
            raise ValueError(f"side must be a positive multiple of {MULTIPLE_OF}, got {self.side}")


def learning_rate_at(step: int, options: TrainOptions) -> float:
    """Warm up linearly over 300 steps, then follow a cosine down to 1 % of the peak."""
    return warm_cosine(step, options.steps, options.learning_rate, WARM_UP_STEPS)


def forward(network: SmearUNet, images: Tensor) -> Tensor:
    """Compute raw heads in float32; all but the stem runs in bfloat16 (twice as fast on recent CPUs)."""
    with torch.no_grad():  # the stem has no parameters
        features = network.stem(images)
    with torch.autocast(images.device.type, dtype=torch.bfloat16):
        return network.body(features.contiguous(memory_format=torch.channels_last)).float()


def advance(run: Run, images: Tensor, targets: Tensor, options: TrainOptions) -> Loss:
    """Make one optimiser step on images (N, 3, side, side) and targets (N, 3, side / 4, side / 4)."""
    for group in run.optimiser.param_groups:
        group["lr"] = learning_rate_at(run.step, options)
    device = next(run.network.parameters()).device
    images = images.to(device, memory_format=torch.channels_last)
    loss = loss_of(forward(run.network, images), targets.to(device), options.alpha)
    run.optimiser.zero_grad(set_to_none=True)
    torch.autograd.backward(loss.total)
    average_gradients(run.network)
    torch.nn.utils.clip_grad_norm_(run.network.parameters(), 2.0)
    run.optimiser.step()
    run.step += 1
    follow(run.average, run.network, run.step)
    return loss.detached()


def average_gradients(network: SmearUNet) -> None:
    """Replace each gradient by its mean over the training processes, if there are several."""
    if not distributed.is_initialized():
        return
    gradients = [p.grad for p in network.parameters() if p.grad is not None]
    flat = torch.cat([gradient.reshape(-1) for gradient in gradients])
    distributed.all_reduce(flat)
    parts = (flat / distributed.get_world_size()).split([gradient.numel() for gradient in gradients])
    for gradient, part in zip(gradients, parts, strict=True):
        gradient.copy_(part.view_as(gradient))


def batches_of(
    scenes: Scenes, options: TrainOptions, first: int, rank: int = 0
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield one training process's batches from number `first` on, made by `workers` processes."""
    seed = options.seed + RANK_SEED * rank
    stream = CropStream(scenes, seed, options.batch, options.side, first=first)
    ahead = 4 if options.workers else None
    return iter(DataLoader(stream, batch_size=None, num_workers=options.workers, prefetch_factor=ahead))


def train_as(rank: int, options: TrainOptions) -> None:
    """Train as one of several processes on this machine."""
    torch.set_num_threads(max(1, len(os.sched_getaffinity(0)) // options.processes))
    meeting = options.out / "processes"
    distributed.init_process_group(
        "gloo", init_method=meeting.absolute().as_uri(), rank=rank, world_size=options.processes
    )
    train(options, rank)


def train_in_parallel(options: TrainOptions) -> None:
    """Start the training processes and wait for them."""
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "processes").unlink(missing_ok=True)
    torch.multiprocessing.spawn(train_as, args=(options,), nprocs=options.processes)  # type: ignore[attr-defined, no-untyped-call]


def train(options: TrainOptions, rank: int = 0) -> Run:
    """Run the schedule to its end; the first process prints and logs, and keeps ``out/last.pt`` fresh."""
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    options.out.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)  # ends OpenCV's pool: workers are forked, and would wait for threads they lack
    scenes, (images, targets) = load_shards(options.train), validation_crops(options.val)
    last = options.out / "last.pt"
    run = start_run(options.seed, options.learning_rate, device, last, options.weights)
    print(f"{len(scenes)} scenes, from step {run.step} on {device}", flush=True)
    batches = batches_of(scenes, options, run.step, rank)
    losses: list[Loss] = []
    run.network.train()
    began = time.perf_counter()
    while run.step < options.steps:
        losses.append(advance(run, *next(batches), options))
        done = run.step == options.steps
        if rank:
            losses.clear()
            continue
        if done or run.step % options.validate_every == 0:
            crops_per_s = options.processes * options.batch * len(losses) / (time.perf_counter() - began)
            run.figures = asdict(figures_of(predict(run.average, images, device), targets))
            report(run, options.out / "log.jsonl", crops_per_s, losses)
            losses, began = [], time.perf_counter()
        if done or run.step % options.save_every == 0:
            run.save(last, asdict(options), len(scenes))
    return run


def train_all(options: TrainOptions) -> None:
    """Train in one process or in several."""
    if options.processes > 1:
        train_in_parallel(options)
    else:
        train(options)


def report(run: Run, log: Path, crops_per_s: float, losses: list[Loss]) -> None:
    """Print one line, and append it to the log: step, speed, figures, mean losses since the line before."""
    rows = [loss.values() for loss in losses]
    means = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
    line = {"step": run.step, "crops_per_s": round(crops_per_s, 1), **run.figures, **means}
    print("  ".join(f"{k} {v:.4g}" for k, v in line.items()), flush=True)
    with log.open("a") as file:
        file.write(json.dumps(line) + "\n")


def parse() -> TrainOptions:
    """Read the command line; the defaults are those of :class:`TrainOptions`."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    for field in fields(TrainOptions):
        name = f"--{field.name.replace('_', '-')}"
        if field.default is MISSING:
            parser.add_argument(name, type=Path, required=True)
        elif field.default is None:
            parser.add_argument(name, type=Path)
        else:
            parser.add_argument(name, type=type(field.default), default=field.default)
    return TrainOptions(**vars(parser.parse_args()))


def main() -> None:
    """Command line."""
    options = parse()
    try:
        for folder in (options.train, options.val):
            require_shards(folder)
    except Blur2ViewError as error:
        raise SystemExit(str(error)) from None
    train_all(options)


if __name__ == "__main__":
    main()
