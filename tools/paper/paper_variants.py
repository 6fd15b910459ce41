"""The variants of the paper's Table 1 and of its alpha study: same budget, data and seeds for each.

The six losses, and 3 more values of alpha. Budget of one run: 2000 steps of 16 crops of 128 px. Runs of one
seed share crops and stem features, which are computed once: about 6.5 minutes of one core for each run.
"""

import copy
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset

from blur2view.arrays import AnyArray as Array
from tools.datasets.shards import Example, decode_linear, load_shards
from tools.evaluation.smear_figures import Smears, evaluate_smears
from tools.metrics import epe_s, sparsification_curve
from tools.pages import Record
from tools.paper.networks import StemUNet, StructureStem
from tools.paper.paper_loss import Representation, decoded, paper_loss
from tools.rendering.exposure import GRID
from tools.rendering.sensor import log_uniform, photograph
from tools.training.run import TrainingRun, warm_cosine

VALIDATION_CROPS, VALIDATION_SIDE, VALIDATION_SEED = 128, 240, 12345
LONGEST_PX = 400  # displacements from here on, and those that overflowed when stored, become invalid zeros


def orient(
    image: Array, displacement: Array, labels: Array, turns: int, mirror: bool
) -> tuple[Array, Array, Array]:
    """Turn counter-clockwise by 90 degrees `turns` times, then mirror left to right: picture and truth."""
    image, displacement, labels = (np.rot90(a, turns) for a in (image, displacement, labels))
    for _ in range(turns):
        displacement = np.stack([displacement[..., 1], -displacement[..., 0]], -1)
    if mirror:
        image, labels = image[:, ::-1], labels[:, ::-1]
        displacement = displacement[:, ::-1] * np.array([-1, 1], displacement.dtype)
    return image, displacement, labels


def cut(rng: np.random.Generator, scenes: Example, index: int, side: int) -> tuple[Array, Array, Array]:
    """Cut a square of one scene at a random place and scale: linear (side, side, 3) and its grid truth."""
    height, width = scenes["linear"].shape[1:3]
    magnified = log_uniform(rng, (0.6, 1.35)) if rng.random() < 0.5 else 1.0
    source = int(min(side / magnified, height, width)) // GRID * GRID
    x, y = (int(rng.integers(0, (extent - source) // GRID + 1)) * GRID for extent in (width, height))
    linear = decode_linear(scenes["linear"][index, y : y + source, x : x + source])
    cells = (index, slice(y // GRID, (y + source) // GRID), slice(x // GRID, (x + source) // GRID))
    displacement, labels = scenes["displacement"][cells].astype(np.float32), scenes["labels"][cells]
    return (linear, displacement, labels) if source == side else resized(linear, displacement, labels, side)


def resized(linear: Array, displacement: Array, labels: Array, side: int) -> tuple[Array, Array, Array]:
    """Resize a square picture and its truth to `side` pixels; displacements grow with the picture."""
    scale, cells = side / len(linear), (side // GRID, side // GRID)
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    picture = np.asarray(cv2.resize(linear, (side, side), interpolation=how))
    nearest = np.asarray(cv2.resize(displacement, cells, interpolation=cv2.INTER_NEAREST_EXACT))
    labels = np.asarray(cv2.resize(labels, cells, interpolation=cv2.INTER_NEAREST_EXACT))
    return picture, nearest * np.float32(scale), labels


def crop(rng: np.random.Generator, scenes: Example, index: int, side: int) -> tuple[Array, Array]:
    """Make one augmented training pair, float32.

    An image (3, side, side) in [0, 1], and its finite target (3, side / 4, side / 4): displacement x, y in
    pixels and validity (0 or 1).
    """
    linear, displacement, labels = cut(rng, scenes, index, side)
    turns, mirror = int(rng.integers(4)), bool(rng.random() < 0.5)
    linear, displacement, labels = orient(linear, displacement, labels, turns, mirror)
    image = photograph(rng, np.ascontiguousarray(linear)).astype(np.float32) / 255
    usable = np.all(np.abs(displacement) < LONGEST_PX, axis=-1, keepdims=True)  # false for NaN, too
    valid = (labels[..., None] & 1) * usable
    target = np.concatenate([np.where(usable, displacement, 0), valid], -1).astype(np.float32)
    return np.ascontiguousarray(image.transpose(2, 0, 1)), np.ascontiguousarray(target.transpose(2, 0, 1))


class CropBatches(Dataset[tuple[Tensor, Tensor]]):
    """Batches of crops; batch k depends only on (seed, k), whichever process makes it."""

    def __init__(self, scenes: Example, seed: int, batch: int, side: int) -> None:
        self.scenes, self.seed, self.batch, self.side = scenes, seed, batch, side

    def __getitem__(self, k: int) -> tuple[Tensor, Tensor]:
        """Return batch number k: images (N, 3, side, side) and targets (N, 3, side / 4, side / 4)."""
        rng = np.random.default_rng([self.seed, k])
        indices = rng.integers(0, len(self.scenes["labels"]), self.batch)
        pairs = [crop(rng, self.scenes, int(i), self.side) for i in indices]
        images, targets = zip(*pairs, strict=True)
        return torch.from_numpy(np.stack(images)), torch.from_numpy(np.stack(targets))


def validation_crops(folder: Path) -> tuple[Tensor, Tensor]:
    """Cut fixed crops of held-out scenes: the same pictures, cameras and noise for every run."""
    return CropBatches(load_shards(folder), VALIDATION_SEED, VALIDATION_CROPS, VALIDATION_SIDE)[0]


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
def predict(network: nn.Module, images: Tensor, representation: Representation) -> tuple[Array, Array]:
    """Return displacements (N, h, w, 2) and sigmas (N, h, w) of images (N, 3, H, W)."""
    network.eval()
    device = next(network.parameters()).device
    raw = torch.cat([network(part.to(device)).cpu() for part in images.split(16)])
    return decoded(raw, representation)


def judged(displacement: Array, sigma: Array, truth: Tensor) -> dict[str, float]:
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
