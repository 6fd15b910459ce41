"""Train the variants of the paper's Table 1 and of its alpha study: same budget, data and seeds for each.

The six losses, and 3 more values of alpha, with 3 seeds each. Budget of one run: 2000 steps of 16 crops of
128 px. Runs of one seed share crops and stem features, which are computed once: about 6.5 minutes of one core
for each run. Finished ones (NAME_SEED.json in `TrainOptions.out`) are not trained again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader

from blur2view.arrays import AnyArray
from tools.datasets.shards import Scenes, load_shards
from tools.metrics import (
    DIRECTION_MIN_PX,
    direction_error_deg,
    epe_s,
    sparsification_area,
    sparsification_curve,
)
from tools.pages import write_json
from tools.paper.crops import CropBatches, validation_crops
from tools.paper.networks import StemUNet
from tools.paper.paper_loss import Representation, decoded, paper_loss
from tools.training.run import TrainingRun
from tools.training.schedule import warm_cosine

ALPHA = 0.01
STEPS = 2000
PEAK_RATE, LARGEST_GRADIENT = 2e-3, 2.0


@dataclass(frozen=True, kw_only=True)
class Variant:
    """What is trained: the paper's outputs and losses on a U-Net behind our stem."""

    representation: Representation = "double"
    cross_check: bool = True
    alpha: float = ALPHA

    @property
    def name(self) -> str:
        """Name of its files."""
        check = "map" if self.cross_check else "nomap"
        return f"stem_{self.representation}_{check}_{self.alpha:g}"


SIX = tuple(
    Variant(representation=representation, cross_check=check)
    for representation in ("local", "restricted", "double")
    for check in (False, True)
)
ALPHA_STUDY = tuple(Variant(alpha=alpha) for alpha in (0.005, 0.01, 0.02, 0.05))
VARIANTS = {variant.name: variant for variant in (*SIX, *ALPHA_STUDY)}


@dataclass(kw_only=True)
class VariantRun(TrainingRun):
    """Networks, optimiser and step of one run; `history` has the mean loss of every hundred steps."""

    network: StemUNet
    average: StemUNet
    variant: Variant
    history: list[float] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """The budget of one training, and where things are.

    ``train`` and ``val`` hold rendered shards, ``out`` gets results. A run has ``steps``, each of ``batch``
    crops of ``side`` px (a multiple of 16), which ``workers`` processes make (0: this one).
    """

    train: Path
    val: Path
    out: Path
    steps: int = STEPS
    batch: int = 16
    side: int = 128
    workers: int = 1


def start(variant: Variant, seed: int, device: torch.device) -> VariantRun:
    """Return a new run; its weights follow from the seed."""
    torch.manual_seed(seed)
    network, average = StemUNet().to(device), StemUNet().to(device)
    average.load_state_dict(network.state_dict())
    optimiser = torch.optim.AdamW(network.parameters(), lr=PEAK_RATE, weight_decay=1e-4)
    network.train()
    return VariantRun(variant=variant, network=network, average=average, optimiser=optimiser)


def advance(run: VariantRun, features: Tensor, targets: Tensor, steps: int) -> float:
    """Make one of so many steps, on features of the stem, in bfloat16; return the loss."""
    v = run.variant
    with torch.autocast(features.device.type, dtype=torch.bfloat16):
        raw = run.network.body(features)
    loss = paper_loss(raw.float(), targets, v.representation, v.cross_check, v.alpha)
    return run.descend(loss, warm_cosine(run.step, steps, PEAK_RATE, steps // 10), LARGEST_GRADIENT)


def train(variants: Sequence[Variant], seed: int, options: TrainOptions, scenes: Scenes) -> list[VariantRun]:
    """Return trained variants, which share crops and the features of the stem, which has no weights."""
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    runs = [start(variant, seed, device) for variant in variants]
    losses: list[list[float]] = [[] for _ in runs]
    crops = CropBatches(scenes, seed, options.batch, options.side)
    loader = DataLoader(crops, batch_size=None, sampler=range(options.steps), num_workers=options.workers)
    for step, batch in enumerate(loader, 1):
        images, targets = (tensor.to(device) for tensor in batch)
        with torch.no_grad():
            features = runs[0].network.stem(images).contiguous(memory_format=torch.channels_last)
        for run, recent in zip(runs, losses, strict=True):
            recent.append(advance(run, features, targets, options.steps))
            if step == options.steps or step % 100 == 0:
                run.history.append(float(np.mean(recent)))
                print(f"{run.variant.name}_{seed}: step {step}, loss {run.history[-1]:.3f}", flush=True)
                recent.clear()
    return runs


@torch.no_grad()
def predict(run: VariantRun, images: Tensor) -> tuple[AnyArray, AnyArray]:
    """Return displacements (N, h, w, 2) and sigmas (N, h, w) of images (N, 3, H, W)."""
    network, device = run.average.eval(), next(run.average.parameters()).device
    raw = torch.cat([network(images[k : k + 16].to(device)).cpu() for k in range(0, len(images), 16)])
    return decoded(raw, run.variant.representation)


def judged(displacement: AnyArray, sigma: AnyArray, truth: Tensor) -> dict[str, Any]:
    """Return the figures of predictions (N, h, w, 2), (N, h, w) on crops with their truth (N, 3, h, w).

    EPE-S in px and over the length, directions of smears of at least 4 px; "top50" is the half of the smaller
    sigmas. ``epe_s_left`` is the mean in px of the sparsification curve by sigma, ``epe_s_oracle`` that of
    the curve by the error.
    """
    target = truth.permute(0, 2, 3, 1).numpy()
    seen = target[..., 2] > 0
    found, true, sigma = displacement[seen], target[seen][:, :2], sigma[seen]
    error, angle_deg = epe_s(found, true), direction_error_deg(found, true)
    length = np.linalg.norm(true, axis=1)
    certain, long = sigma <= np.quantile(sigma, 0.5, method="lower"), length >= DIRECTION_MIN_PX
    _, by_sigma, by_error = sparsification_curve(error, sigma)
    figures = {
        "epe_s": error.mean(),
        "epe_s_top50": error[certain].mean(),
        "epe_s_top50_over_length": error[certain].mean() / length[certain].mean(),
        "direction_deg": np.median(angle_deg[long]),
        "direction_deg_top50": np.median(angle_deg[long & certain]),
        "sparsification_area": sparsification_area(error, sigma),
        "epe_s_left": np.mean(by_sigma) * error.mean(),
        "epe_s_oracle": np.mean(by_error) * error.mean(),
    }
    return {name: float(value) for name, value in figures.items()}


def run_all(variants: Sequence[Variant], seeds: Sequence[int], options: TrainOptions) -> None:
    """Train and judge what is not finished; seeds in the outer loop, so that early results compare all."""
    cv2.setNumThreads(1)  # ends OpenCV's pool: workers are forked, and would wait for threads they lack
    scenes, (images, truth) = load_shards(options.train), validation_crops(options.val)
    for seed in seeds:
        left = [v for v in variants if not (options.out / f"{v.name}_{seed}.json").exists()]
        for run in train(left, seed, options, scenes) if left else []:
            document = {
                "variant": vars(run.variant), "seed": seed, "steps": options.steps, "batch": options.batch,
                "side": options.side, "scenes": len(scenes), "history": run.history,
                **judged(*predict(run, images), truth),
            }  # fmt: skip
            write_json(options.out / f"{run.variant.name}_{seed}.json", document)
