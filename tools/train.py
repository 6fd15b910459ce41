"""Train the smear network on rendered scenes, on a CPU or a GPU; a stopped run resumes.

From nothing to a checkpoint::

    python -m tools.render dataset --out render/train --scenes 6000 --photos KODAK
    python -m tools.render dataset --out render/val --scenes 100 --split test --photos KODAK
    python -m tools.train --train render/train --val render/val --out runs/smear --steps 30000

Run the last line again to go on from ``runs/smear/last.pt``. The loss has three parts (DESIGN, section 4):
orientation as a chord on the double-angle circle, weighted down for tiny smears; log length; and the
uncertainty, by the negative log likelihood of the end-point error with the paper's cross-check term, whose
gradient does not reach orientation and length.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader

from tools.crops import CropStream, load_shards
from tools.model import ModelOptions, SmearUNet, decode


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """One training run.

    Attributes
    ----------
    train, val, out : Path
        Folders of rendered shards, and of checkpoints and the log.
    steps : int
        Length of the whole run; the learning rate falls to zero over it along a cosine.
    batch, side : int
        Crops a step and their side in pixels (a multiple of 64).
    learning_rate : float
        Peak of the schedule (AdamW).
    alpha : float
        The paper's bound on 1 / sigma^2 where the cross-check fails.
    seed : int
        Decides the initial weights and every crop.
    workers : int
        Processes that make crops.
    save_every, validate_every : int
        Steps between checkpoints and between validations.
    """

    train: Path
    val: Path
    out: Path
    steps: int = 30000
    batch: int = 24
    side: int = 128
    learning_rate: float = 2e-3
    alpha: float = 0.01
    seed: int = 0
    workers: int = 1
    save_every: int = 250
    validate_every: int = 500


def target_parts(target: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Truth (N, 3, h, w) to unit double angle (N, 2, h, w), length (N, 1, h, w) and validity (N, 1, h, w)."""
    x, y, valid = target[:, :1], target[:, 1:2], target[:, 2:]
    length = torch.sqrt(x * x + y * y + 1e-12)
    unit = torch.cat([(x * x - y * y), 2 * x * y], 1) / (length * length)
    return unit, length, valid


def smear_error(predicted: Tensor, unit: Tensor, length: Tensor) -> Tensor:
    """EPE-S (N, 1, h, w) in px of decoded predictions (N, 3, h, w): the smaller of |d - d*| and |d + d*|."""
    double = predicted[:, :2]
    mine = torch.sqrt((double * double).sum(1, keepdim=True) + 1e-12)
    cosine = ((double * unit).sum(1, keepdim=True) / mine).clamp(-1, 1)
    half_cosine = torch.sqrt((1 + cosine) / 2 + 1e-12)  # |cos| of the angle between the smears themselves
    return torch.sqrt((mine - length) ** 2 + 2 * mine * length * (1 - half_cosine) + 1e-6)


def loss_of(raw: Tensor, target: Tensor, alpha: float) -> tuple[Tensor, dict[str, float]]:
    """Sum of the three parts, and their values.

    Parameters
    ----------
    raw : Tensor of shape (N, 4, h, w)
        The network's heads.
    target : Tensor of shape (N, 3, h, w)
        Displacement in pixels and validity.
    alpha : float
        See :class:`TrainOptions`.
    """
    unit, length, valid = target_parts(target)
    weight = valid + 0.2 * (1 - valid)
    mine = raw[:, :2] / torch.sqrt((raw[:, :2] ** 2).sum(1, keepdim=True) + 1e-4)
    chord = torch.sqrt(((mine - unit) ** 2).sum(1, keepdim=True) + 1e-4)
    clear = length**2 / (length**2 + 4)
    orientation = (weight * clear * chord).mean()
    miss = torch.nn.functional.smooth_l1_loss(raw[:, 2:3], torch.log1p(length), reduction="none", beta=0.1)
    log_length = (weight * miss).mean()
    error = smear_error(decode(raw), unit, length).detach()
    log_sigma = raw[:, 3:4].clamp(-3.0, 4.5)
    likelihood = error * torch.exp(-log_sigma) + log_sigma  # Laplace: sigma is the expected end-point error
    hidden = torch.relu(torch.exp(-2 * log_sigma) - alpha)
    uncertainty = (valid * likelihood + (1 - valid) * hidden).mean()
    total = orientation + 2 * log_length + 0.25 * uncertainty
    parts = {"orientation": orientation, "length": log_length, "sigma": uncertainty}
    return total, {name: float(part.detach()) for name, part in parts.items()}


def learning_rate_at(step: int, options: TrainOptions) -> float:
    """Linear warm-up over 300 steps, then a cosine down to 1 % of the peak."""
    warm = min(1.0, (step + 1) / 300)
    fall = 0.5 * (1 + math.cos(math.pi * min(1.0, step / options.steps)))
    return options.learning_rate * warm * (0.01 + 0.99 * fall)


def forward(network: SmearUNet, images: Tensor) -> Tensor:
    """Raw heads in float32; while training all but the stem runs in bfloat16 (twice as fast on recent CPUs)."""
    features = network.stem(images)
    with torch.autocast(images.device.type, dtype=torch.bfloat16, enabled=network.training):
        return network.body(features.contiguous(memory_format=torch.channels_last)).float()


def validation_crops(folder: Path, side: int) -> tuple[Tensor, Tensor]:
    """Fixed crops of held-out scenes: the same pictures, cameras and noise for every run."""
    stream = CropStream(load_shards(folder), seed=12345, batch=256, side=side)
    return stream.make(0)


@torch.no_grad()
def validate(network: SmearUNet, images: Tensor, targets: Tensor, device: torch.device) -> dict[str, float]:
    """EPE-S, its ratio to the mean length over the certain half, direction error, length ratio."""
    network.eval()
    decoded = torch.cat([decode(forward(network, chunk.to(device))).cpu() for chunk in images.split(32)])
    network.train()
    unit, length, valid = target_parts(targets)
    error, seen = smear_error(decoded, unit, length)[valid > 0], valid > 0
    sigma, true = decoded[:, 2:][seen], length[seen]
    certain = sigma <= sigma.median()
    mine = torch.linalg.norm(decoded[:, :2], dim=1, keepdim=True)
    cosine = ((decoded[:, :2] * unit).sum(1, keepdim=True) / (mine + 1e-6)).clamp(-1, 1)[seen]
    angle = torch.rad2deg(torch.acos(cosine)) / 2
    long = true >= 4
    ratio = torch.log((mine[seen][long] + 0.1) / true[long])
    return {
        "epe_s": float(error.mean()),
        "epe_s_top50": float(error[certain].mean()),
        "epe_s_top50_over_length": float(error[certain].mean() / true[certain].mean()),
        "direction_deg": float(angle[long].median()),
        "direction_deg_top50": float(angle[long & certain].median()),
        "length_ratio": float(ratio.median().exp()),
        "length_spread": float((ratio - ratio.median()).abs().median()),
    }


@dataclass
class Run:
    """What a checkpoint holds."""

    network: SmearUNet
    average: SmearUNet
    optimiser: torch.optim.Optimizer
    step: int = 0

    def save(self, path: Path, options: TrainOptions, figures: dict[str, float]) -> None:
        """Write the checkpoint; a run killed meanwhile keeps the one before."""
        plain = {k: str(v) if isinstance(v, Path) else v for k, v in asdict(options).items()}
        state = {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "model_options": self.network.options.as_dict(),
            "options": plain,
            "figures": figures,
        }
        temporary = path.with_suffix(".tmp")
        torch.save(state, temporary)
        temporary.replace(path)

    def load(self, path: Path) -> None:
        """Go on from a checkpoint."""
        state = torch.load(path, map_location="cpu", weights_only=True)
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step = int(state["step"])


def load_average(path: Path) -> tuple[SmearUNet, dict[str, Any]]:
    """Averaged network of a checkpoint, ready for inference, and the checkpoint's other fields."""
    state = torch.load(path, map_location="cpu", weights_only=True)
    network = SmearUNet(ModelOptions(**{k: tuple(v) for k, v in state["model_options"].items()}))
    network.load_state_dict(state["average"])
    return network.eval(), state


def start_run(options: TrainOptions, device: torch.device) -> Run:
    """Return a fresh run, or the one in ``out/last.pt``."""
    torch.manual_seed(options.seed)
    network = SmearUNet().to(device, memory_format=torch.channels_last)
    average = SmearUNet().to(device, memory_format=torch.channels_last)
    average.load_state_dict(network.state_dict())
    optimiser = torch.optim.AdamW(network.parameters(), lr=options.learning_rate, weight_decay=1e-4)
    run = Run(network=network, average=average, optimiser=optimiser)
    if (options.out / "last.pt").exists():
        run.load(options.out / "last.pt")
    return run


@torch.no_grad()
def follow(average: SmearUNet, network: SmearUNet, step: int) -> None:
    """Exponential moving average of weights and statistics, over about the last 500 steps."""
    decay = min(0.998, (1 + step) / (10 + step))
    for mean, value in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
        if mean.dtype.is_floating_point:
            mean.lerp_(value, 1 - decay)
        else:
            mean.copy_(value)


def train(options: TrainOptions) -> None:
    """Run the schedule to its end; print and log the figures."""
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    options.out.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(0)  # workers are forked, and a forked OpenCV thread pool hangs
    scenes = load_shards(options.train)
    fixed = validation_crops(options.val, 192)
    run = start_run(options, device)
    print(f"{len(scenes['labels'])} scenes, from step {run.step} on {device}", flush=True)
    stream = CropStream(scenes, options.seed, options.batch, options.side, first=run.step)
    batches = iter(DataLoader(stream, batch_size=None, num_workers=options.workers, prefetch_factor=4))
    figures: dict[str, float] = {}
    sums: dict[str, list[float]] = {}
    run.network.train()
    began = time.perf_counter()
    while run.step < options.steps:
        parts = advance(run, *next(batches), options, device)
        for name, value in parts.items():
            sums.setdefault(name, []).append(value)
        if run.step % options.validate_every == 0 or run.step == options.steps:
            rate = options.batch * len(sums["sigma"]) / (time.perf_counter() - began)
            figures = validate(run.average, *fixed, device)
            report(options, run.step, rate, figures, {k: float(np.mean(v)) for k, v in sums.items()})
            sums, began = {}, time.perf_counter()
        if run.step % options.save_every == 0 or run.step == options.steps:
            run.save(options.out / "last.pt", options, figures)


def advance(
    run: Run, images: Tensor, targets: Tensor, options: TrainOptions, device: torch.device
) -> dict[str, float]:
    """One optimiser step."""
    for group in run.optimiser.param_groups:
        group["lr"] = learning_rate_at(run.step, options)
    images = images.to(device, memory_format=torch.channels_last)
    loss, parts = loss_of(forward(run.network, images), targets.to(device), options.alpha)
    run.optimiser.zero_grad(set_to_none=True)
    loss.backward()
    torch.nn.utils.clip_grad_norm_(run.network.parameters(), 2.0)
    run.optimiser.step()
    run.step += 1
    follow(run.average, run.network, run.step)
    return parts


def report(
    options: TrainOptions, step: int, rate: float, figures: dict[str, float], losses: dict[str, float]
) -> None:
    """Print one line and append it to the log."""
    row = {"step": step, "crops_per_s": round(rate, 1), **figures, **losses}
    print("  ".join(f"{k} {v:.4g}" for k, v in row.items()), flush=True)
    with (options.out / "log.jsonl").open("a") as log:
        log.write(json.dumps(row) + "\n")


def parse() -> TrainOptions:
    """Command line; the defaults are those of :class:`TrainOptions`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for f in fields(TrainOptions):
        required = f.name in ("train", "val", "out")
        kind = Path if required else type(f.default)
        default = None if required else f.default
        parser.add_argument(f"--{f.name.replace('_', '-')}", type=kind, required=required, default=default)
    return TrainOptions(**vars(parser.parse_args()))


if __name__ == "__main__":
    train(parse())
