"""Train the variants of the paper's Table 1 and of its alpha study: same budget, data and seeds for each.

7 variants and 3 more of the alpha study, with 3 seeds each. Budget of one run: 2000 steps of 16 crops of
128 px; the plain U-Net at full resolution takes 28 times as long a step and gets 71. Runs of one seed share
crops and stem features, which are computed once: about 6.5 minutes of one core for each run. A stopped run
goes on from its checkpoint; finished ones (NAME_SEED.json in `TrainOptions.out`) are not trained again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import torch
from torch import Tensor, nn

from blur2view.errors import Blur2ViewError
from tools.datasets.shards import Scenes, load_shards
from tools.metrics import DIRECTION_MIN_PX, sparsification_area, sparsification_curve
from tools.paper.crops import TrainOptions, batches_of, validation_crops
from tools.paper.networks import PlainUNet, StemUNet
from tools.paper.paper_loss import Representation, decoded, paper_loss, smear_error, target_parts
from tools.training.run import TrainingRun
from tools.training.schedule import warm_cosine

NetworkName = Literal["stem", "plain"]
ALPHA = 0.01
STEPS, PLAIN_STEPS = 2000, 71
LARGEST_GRADIENT = 2.0
"""Budget of one run; a step of the plain U-Net takes 28 times as long."""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """What is trained: the paper's outputs and losses on its "plain" U-Net, or on one behind our "stem"."""

    network: NetworkName
    representation: Representation = "double"
    cross_check: bool = True
    alpha: float = ALPHA

    @property
    def name(self) -> str:
        """Name of its files."""
        check = "map" if self.cross_check else "nomap"
        return f"{self.network}_{self.representation}_{check}_{self.alpha:g}"


SIX = tuple(
    Variant(network="stem", representation=representation, cross_check=check)
    for representation in ("local", "restricted", "double")
    for check in (False, True)
)
TABLE_1 = (*SIX, Variant(network="plain"))
ALPHA_STUDY = tuple(Variant(network="stem", alpha=alpha) for alpha in (0.005, 0.01, 0.02, 0.05))
VARIANTS = {variant.name: variant for variant in (*TABLE_1, *ALPHA_STUDY)}


@dataclass(kw_only=True)
class VariantRun(TrainingRun):
    """Networks, optimiser and step of one run; `history` has the mean loss of every hundred steps."""

    variant: Variant
    history: list[float] = field(default_factory=list)

    def save(self, path: Path) -> None:
        """Write a checkpoint."""
        self.write(path, history=self.history)

    def load(self, path: Path) -> None:
        """Go on from a checkpoint."""
        self.history = list(self.restore(path)["history"])


def build(variant: Variant) -> nn.Module:
    """Return an untrained network."""
    return StemUNet() if variant.network == "stem" else PlainUNet()


def start(variant: Variant, seed: int, learning_rate: float, device: torch.device) -> VariantRun:
    """Return a new run; its weights follow from the seed."""
    torch.manual_seed(seed)
    network, average = build(variant).to(device), build(variant).to(device)
    average.load_state_dict(network.state_dict())
    optimiser = torch.optim.AdamW(network.parameters(), lr=learning_rate, weight_decay=1e-4)
    return VariantRun(variant=variant, network=network, average=average, optimiser=optimiser)


def learning_rate_at(step: int, options: TrainOptions) -> float:
    """Return a rate that rises linearly for a tenth of the steps, then falls by a cosine to 1 %."""
    return warm_cosine(step, options.steps, options.learning_rate, options.steps // 10)


def shared_input(network: nn.Module, images: Tensor) -> Tensor:
    """Return what networks of one kind share: the features of our stem, which has no parameters, or RGB."""
    if not isinstance(network, StemUNet):
        return images
    with torch.no_grad():
        features: Tensor = network.stem(images)
    return features.contiguous(memory_format=torch.channels_last)


def raw_output(network: nn.Module, inputs: Tensor) -> Tensor:
    """Return the output of a network in training on its :func:`shared_input`, in bfloat16."""
    with torch.autocast(inputs.device.type, dtype=torch.bfloat16):
        output: Tensor = network.body(inputs) if isinstance(network, StemUNet) else network(inputs)
    return output.float()


def advance(run: VariantRun, inputs: Tensor, targets: Tensor, options: TrainOptions) -> float:
    """Make one step on a :func:`shared_input`; return the loss."""
    v = run.variant
    loss = paper_loss(raw_output(run.network, inputs), targets, v.representation, v.cross_check, v.alpha)
    return run.descend(loss, learning_rate_at(run.step, options), LARGEST_GRADIENT)


def train(variants: Sequence[Variant], seed: int, options: TrainOptions, scenes: Scenes) -> list[VariantRun]:
    """Return variants of one kind of network trained to the end, from their last checkpoints.

    They share crops and stem features, which are computed once; one that is further on waits for the rest.
    """
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    runs = [start(variant, seed, options.learning_rate, device) for variant in variants]
    files = [options.out / f"{variant.name}_{seed}.pt" for variant in variants]
    for run, last in zip(runs, files, strict=True):
        if last.exists():
            run.load(last)
        if run.step > options.steps:
            raise Blur2ViewError(f"{last} has made {run.step} steps, more than {options.steps}; move it away")
        run.network.train()
    first = min(run.step for run in runs)
    batches = batches_of(scenes, options, first)
    losses: dict[str, list[float]] = {variant.name: [] for variant in variants}
    for step in range(first, options.steps):
        images, targets = (tensor.to(device) for tensor in next(batches))
        inputs = shared_input(runs[0].network, images)
        for run, last in zip(runs, files, strict=True):
            if run.step != step:
                continue
            recent = losses[run.variant.name]
            recent.append(advance(run, inputs, targets, options))
            done = run.step == options.steps
            if done or run.step % 100 == 0:
                run.history.append(float(np.mean(recent)))
                print(f"{last.stem}: step {run.step}, loss {run.history[-1]:.3f}", flush=True)
                recent.clear()
            if done or run.step % options.save_every == 0:
                run.save(last)
    return runs


@torch.no_grad()
def predict(run: VariantRun, images: Tensor) -> Tensor:
    """Return double angle and sigma (N, 3, h, w) of images (N, 3, H, W) by the averaged network."""
    network, device = run.average.eval(), next(run.average.parameters()).device
    raw = torch.cat([network(images[k : k + 16].to(device)).cpu() for k in range(0, len(images), 16)])
    return decoded(raw, run.variant.representation)


def judged(predicted: Tensor, truth: Tensor) -> dict[str, Any]:
    """Return the figures of predictions (N, 3, h, w) on crops with their truth (N, 3, h, w).

    EPE-S in px and over the length, directions of smears of at least 4 px; "top50" is the half of the smaller
    sigmas. ``epe_s_left`` is the mean in px of the sparsification curve by sigma, ``epe_s_oracle`` that of
    the curve by the error.
    """
    target = target_parts(truth)
    seen = target.valid > 0
    error, sigma, true = (x[seen] for x in (smear_error(predicted, target), predicted[:, 2:3], target.length))
    length = torch.linalg.norm(predicted[:, :2], dim=1, keepdim=True)
    cosine = ((predicted[:, :2] * target.unit).sum(1, keepdim=True) / (length + 1e-6)).clamp(-1, 1)[seen]
    angle_deg = torch.rad2deg(torch.acos(cosine)) / 2
    certain, long = sigma <= sigma.median(), true >= DIRECTION_MIN_PX
    _, by_sigma, by_error = sparsification_curve(error.numpy(), sigma.numpy())
    return {
        "epe_s": float(error.mean()),
        "epe_s_top50": float(error[certain].mean()),
        "epe_s_top50_over_length": float(error[certain].mean() / true[certain].mean()),
        "direction_deg": float(angle_deg[long].median()),
        "direction_deg_top50": float(angle_deg[long & certain].median()),
        "sparsification_area": sparsification_area(error.numpy(), sigma.numpy()),
        "epe_s_left": float(np.mean(by_sigma) * float(error.mean())),
        "epe_s_oracle": float(np.mean(by_error) * float(error.mean())),
    }


def run_all(
    variants: Sequence[Variant], seeds: Sequence[int], options: TrainOptions, plain_steps: int
) -> None:
    """Train and judge what is not finished; seeds in the outer loop, so that early results compare all."""
    options.out.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)  # ends OpenCV's pool: workers are forked, and would wait for threads they lack
    scenes, (images, truth) = load_shards(options.train), validation_crops(options.val)
    for seed in seeds:
        left = [v for v in variants if not (options.out / f"{v.name}_{seed}.json").exists()]
        for network in ("stem", "plain"):  # each shares its inputs
            kind = [variant for variant in left if variant.network == network]
            if not kind:
                continue
            steps = plain_steps if network == "plain" else options.steps
            own = TrainOptions(**(vars(options) | {"steps": steps, "seed": seed}))
            for run in train(kind, seed, own, scenes):
                document = {
                    "variant": vars(run.variant), "seed": seed, "steps": steps, "batch": own.batch,
                    "side": own.side, "scenes": len(scenes), "history": run.history,
                    **judged(predict(run, images), truth),
                }  # fmt: skip
                result = options.out / f"{run.variant.name}_{seed}.json"
                result.write_text(json.dumps(document, indent=1) + "\n")
