"""The variants of the paper's Table 1 and of its alpha study: same budget, data and seeds for each.

The six losses, and 3 more values of alpha. Budget of one run: 2000 steps of 16 crops of 128 px. Runs of one
seed share crops and stem features, which are computed once: about 6.5 minutes of one core for each run.
"""

import copy
from dataclasses import dataclass
from typing import cast

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader

from blur2view.arrays import AnyArray
from tools.datasets.shards import Example
from tools.evaluation.smear_figures import Smears, evaluate_smears
from tools.metrics import epe_s, sparsification_curve
from tools.pages import Record
from tools.paper.crops import CropBatches
from tools.paper.networks import StemUNet
from tools.paper.paper_loss import Representation, decoded, paper_loss
from tools.paper.stem import StructureStem
from tools.training.run import TrainingRun, warm_cosine

PEAK_RATE, LARGEST_GRADIENT = 2e-3, 2.0
MEASURES = (
    "epe_s_top50", "epe_s_top50_over_length", "sparsification_area", "epe_s_left", "epe_s_oracle",
    "direction_deg_top50",
)  # fmt: skip
"""Of all crops' valid smears: EPE-S of the half of smaller sigmas, px and over the length; the area between
the sparsification curves, and the means in px of that by sigma and that by the error; the direction's error
of the surer half of the smears of at least 4 px."""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """What is trained: the paper's outputs and losses on a U-Net behind our stem."""

    representation: Representation = "double"
    cross_check: bool = True
    alpha: float = 0.01

    @property
    def name(self) -> str:
        """Name in records."""
        check = "map" if self.cross_check else "nomap"
        return f"stem_{self.representation}_{check}_{self.alpha:g}"

    @property
    def loss(self) -> str:
        """Name of the loss for people."""
        return f"{self.representation}, {'with' if self.cross_check else 'without'} map"


SIX = tuple(
    Variant(representation=representation, cross_check=check)
    for representation in ("local", "restricted", "double")
    for check in (False, True)
)
ALPHA_STUDY = tuple(Variant(alpha=alpha) for alpha in (0.005, 0.01, 0.02, 0.05))
VARIANTS = tuple(dict.fromkeys((*SIX, *ALPHA_STUDY)))


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """The budget of one run, and the processes that make crops."""

    steps: int = 2000
    batch: int = 16
    side: int = 128
    workers: int = 1


def start(seed: int, device: torch.device) -> TrainingRun:
    """Return a new run; its weights follow from the seed."""
    torch.manual_seed(seed)
    network = StemUNet().to(device)
    optimiser = torch.optim.AdamW(network.parameters(), lr=PEAK_RATE, weight_decay=1e-4)
    return TrainingRun(network=network.train(), average=copy.deepcopy(network), optimiser=optimiser)


def train(seed: int, scenes: Example, options: TrainOptions) -> list[tuple[TrainingRun, list[float]]]:
    """Return trained variants, the bodies of their networks in bfloat16, with the losses of their steps."""
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    runs, stem = [(start(seed, device), list[float]()) for _ in VARIANTS], StructureStem().to(device)
    crops = CropBatches(scenes, seed, options.batch, options.side)
    loader = DataLoader(crops, batch_size=None, sampler=range(options.steps), num_workers=options.workers)
    for step, batch in enumerate(loader):
        images, targets = (tensor.to(device) for tensor in batch)
        rate = warm_cosine(step, options.steps, PEAK_RATE, options.steps // 10)
        with torch.no_grad():
            features = stem(images).contiguous(memory_format=torch.channels_last)
        for v, (run, losses) in zip(VARIANTS, runs, strict=True):
            with torch.autocast(device.type, dtype=torch.bfloat16):
                raw = cast(StemUNet, run.network).body(features)
            loss = paper_loss(raw.float(), targets, v.representation, v.cross_check, v.alpha)
            run.descend(loss, rate, LARGEST_GRADIENT)
            losses.append(float(loss.detach()))
        if step % 100 == 99:
            print(f"seed {seed}: step {step + 1}", *(f"{np.mean(of[-100:]):.3f}" for _, of in runs))
    return runs


@torch.no_grad()
def predict(network: nn.Module, images: Tensor, representation: Representation) -> tuple[AnyArray, AnyArray]:
    """Return displacements (N, h, w, 2) and sigmas (N, h, w) of images (N, 3, H, W)."""
    network.eval()
    device = next(network.parameters()).device
    raw = torch.cat([network(part.to(device)).cpu() for part in images.split(16)])
    return decoded(raw, representation)


def judged(displacement: AnyArray, sigma: AnyArray, truth: Tensor) -> dict[str, float]:
    """Return the MEASURES of predictions (N, h, w, 2), (N, h, w) on crops with their truth (N, 3, h, w)."""
    target = truth.permute(0, 2, 3, 1).numpy()
    seen = target[..., 2] > 0
    found, true, sigma = displacement[seen], target[seen][:, :2], sigma[seen]
    sure, error = sigma <= np.quantile(sigma, 0.5, method="lower"), epe_s(found, true)
    smears = Smears(found=found, true=true, sigma=sigma, sure=sure, blocks=np.empty(0))
    _, by_sigma, by_error = sparsification_curve(error, sigma)
    left = {"epe_s_left": by_sigma.mean() * error.mean(), "epe_s_oracle": by_error.mean() * error.mean()}
    figures = vars(evaluate_smears(smears, len(truth))) | left
    return {name: float(figures[name]) for name in MEASURES}


def run_seed(seed: int, scenes: Example, held: tuple[Tensor, Tensor], options: TrainOptions) -> Record:
    """Train every variant with a seed; return figures on held-out crops and the losses of every 100 steps."""
    images, truth = held
    found = {}
    for v, (run, losses) in zip(VARIANTS, train(seed, scenes, options), strict=True):
        history = [float(np.mean(losses[k : k + 100])) for k in range(0, options.steps, 100)]
        found[v.name] = judged(*predict(run.average, images, v.representation), truth) | {"history": history}
    return found
