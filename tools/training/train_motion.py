"""Train the motion segmentation network.

``python -m tools.training.train_motion render/motion.npz runs/motion.pt`` makes ``--steps`` steps (35 minutes
of one core), saves a checkpoint every few hundred and goes on from it when the line is run again. The same
examples, seed and number of threads give the same weights.
"""

from __future__ import annotations

import argparse
import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as nnf

from blur2view.errors import Blur2ViewError
from tools.training.motion_data import LEAST_SHARE, STATIC, VALID, MotionExamples
from tools.training.motion_model import MotionOptions, MotionUNet
from tools.training.run import TrainingRun
from tools.training.schedule import warm_cosine
from tools.training.stem import STRIDE

Array = NDArray[Any]
Batch = tuple[Tensor, Tensor, Tensor]

LEAST_WEIGHT = 0.2  # of cells whose smear is not known, against 1
OVERLAP_WEIGHT = 0.3  # of the soft overlap, against the cross entropy
WITHOUT_WEIGHT = 0.35  # how often photographs without a mover are drawn, against 1
WARM_UP_STEPS = 200
MIRRORED = np.array(
    [1, -1, 1, -1], np.float32
)  # what mirroring left to right, or up and down, does to angles
TRANSPOSED = np.array([-1, 1, 1, -1], np.float32)
LARGEST_GRADIENT = 2.0
BAD_CHECKPOINT = (OSError, EOFError, KeyError, TypeError, ValueError, RuntimeError, pickle.UnpicklingError)
"""What torch raises of a file that is missing, damaged or of another network."""


@dataclass(frozen=True, kw_only=True)
class MotionTraining:
    """A schedule: windows of ``size`` (height, width) pixels, ``batch`` a step; AdamW, cosine."""

    steps: int = 8000
    batch: int = 8
    size: tuple[int, int] = (192, 256)
    learning_rate: float = 2e-3
    seed: int = 0
    save_every: int = 250

    def facts(self, examples: int) -> dict[str, int]:
        """Return what a checkpoint must have in common with the run that goes on from it."""
        return {"seed": self.seed, "batch": self.batch, "examples": examples}

    def rate_at(self, step: int) -> float:
        """Warm up linearly, then follow a cosine down to 1 % of the peak."""
        return warm_cosine(step, self.steps, self.learning_rate, WARM_UP_STEPS)


def mirrored(image: Array, features: Array, labels: Array, axis: int) -> tuple[Array, Array, Array]:
    """Mirror a photograph (H, W, 3) with features (C, h, w) and labels (h, w) along an axis of the image."""
    features = np.flip(features, axis + 1).copy()
    features[:4] *= MIRRORED[:, None, None]
    return np.flip(image, axis), features, np.flip(labels, axis)


def transposed(image: Array, features: Array, labels: Array) -> tuple[Array, Array, Array]:
    """Exchange x and y."""
    features = features.transpose(0, 2, 1).copy()
    features[:4] *= TRANSPOSED[:, None, None]
    return image.transpose(1, 0, 2), features, labels.T


def window(
    rng: np.random.Generator, examples: MotionExamples, index: int, size: tuple[int, int]
) -> tuple[Array, Array, Array]:
    """Cut a window at a random place of one photograph, mirrored by chance."""
    step = 4 * STRIDE
    tops = [
        int(rng.integers(0, (have - want) // step + 1)) * step
        for have, want in zip(examples.image.shape[1:3], size, strict=True)
    ]
    pixels = tuple(slice(top, top + want) for top, want in zip(tops, size, strict=True))
    cells = tuple(slice(span.start // STRIDE, span.stop // STRIDE) for span in pixels)
    image, labels = examples.image[index][pixels], examples.labels[index][cells]
    features = examples.features[index][(slice(None), *cells)].astype(np.float32)
    for axis in (0, 1):
        if rng.random() < 0.5:
            image, features, labels = mirrored(image, features, labels, axis)
    return image, features, labels


def chances(examples: MotionExamples) -> Array:
    """Return how often each photograph is drawn; those without a mover more seldom."""
    weight = np.where(examples.moving.mean(axis=(1, 2)) >= LEAST_SHARE, 1.0, WITHOUT_WEIGHT)
    return np.asarray(weight / weight.sum())


def batch_of(examples: MotionExamples, chance: Array, options: MotionTraining, step: int) -> Batch:
    """Make batch number ``step``: images, features and labels; it depends on nothing but seed and number."""
    rng = np.random.default_rng([options.seed, step])
    indices = rng.choice(len(examples), options.batch, p=chance)
    parts = [window(rng, examples, int(index), options.size) for index in indices]
    if rng.random() < 0.5:
        parts = [transposed(*part) for part in parts]
    image, features, labels = (np.stack(column) for column in zip(*parts, strict=True))
    planes = np.ascontiguousarray(image.transpose(0, 3, 1, 2)).astype(np.float32) / 255
    return torch.from_numpy(planes), torch.from_numpy(features), torch.from_numpy(labels)


def loss_of(logits: Tensor, labels: Tensor) -> Tensor:
    """Cross entropy of cells, and one minus the soft overlap of photographs with a mover; a scalar."""
    moving, logits = (labels & STATIC == 0).float(), logits[:, 0]
    weight = LEAST_WEIGHT + (1 - LEAST_WEIGHT) * (labels & VALID).float()
    entropy = (nnf.binary_cross_entropy_with_logits(logits, moving, reduction="none") * weight).mean()
    called = torch.sigmoid(logits)
    both = (called * moving * weight).sum((1, 2))
    either = ((called + moving - called * moving) * weight).sum((1, 2))
    counts = (moving.mean((1, 2)) >= LEAST_SHARE).float()
    overlap = ((both + 1) / (either + 1) * counts).sum() / counts.sum().clamp(min=1)
    return entropy + OVERLAP_WEIGHT * (1 - overlap)


@dataclass(kw_only=True)
class MotionRun(TrainingRun):
    """A training of the motion segmentation network."""

    network: MotionUNet
    average: MotionUNet

    @classmethod
    def start(cls, options: MotionTraining, last: Path, examples: int) -> MotionRun:
        """Start anew from the seed, or go on from a checkpoint of the same training."""
        torch.manual_seed(options.seed)
        network, average = MotionUNet(), MotionUNet()
        average.load_state_dict(network.state_dict())
        run = cls(
            network=network,
            average=average,
            optimiser=torch.optim.AdamW(network.parameters(), lr=options.learning_rate, weight_decay=1e-4),
        )
        if last.exists():
            run.go_on(last, options.facts(examples))
            if run.step > options.steps:
                raise Blur2ViewError(f"{last} has made {run.step} steps, more than {options.steps}")
        return run

    def go_on(self, last: Path, facts: dict[str, int]) -> None:
        """Go on from a checkpoint; Blur2ViewError if it is none of this network and training."""
        try:
            before = self.restore(last)["training"]
        except BAD_CHECKPOINT:
            raise Blur2ViewError(f"{last}: is no checkpoint to go on from; move it away") from None
        if before != facts:
            raise Blur2ViewError(f"{last}: is of another training ({before}, not {facts}); move it away")

    def save(self, path: Path, options: MotionTraining, examples: int) -> None:
        """Write a checkpoint; a run killed meanwhile keeps the one before."""
        self.write(path, model_options=self.network.options.as_dict(), training=options.facts(examples))

    def advance(self, batch: Batch, rate: float) -> float:
        """Make one step; return the loss."""
        images, features, labels = batch
        with torch.no_grad():  # the inputs have no parameters
            inputs = self.network.inputs(images, features).contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            logits = self.network.body(inputs)
        return self.descend(loss_of(logits.float(), labels), rate, LARGEST_GRADIENT)


def train(examples: MotionExamples, options: MotionTraining, last: Path) -> MotionRun:
    """Run the schedule to its end, from its last checkpoint if there is one.

    Raises
    ------
    Blur2ViewError
        If the photographs are smaller than a window, or the checkpoint is none.
    """
    have, want = examples.image.shape[1:3], options.size
    if have[0] < want[0] or have[1] < want[1]:
        raise Blur2ViewError(f"photographs of {have[1]}x{have[0]} pixels, windows of {want[1]}x{want[0]}")
    run, chance, losses = MotionRun.start(options, last, len(examples)), chances(examples), []
    run.network.train()
    while run.step < options.steps:
        batch = batch_of(examples, chance, options, run.step)
        losses.append(run.advance(batch, options.rate_at(run.step)))
        if run.step % options.save_every == 0 or run.step == options.steps:
            print(f"step {run.step}, loss {np.mean(losses):.3f}", flush=True)
            run.save(last, options, len(examples))
            losses = []
    return run


def load_network(path: Path) -> tuple[MotionUNet, dict[str, Any]]:
    """Load a checkpoint's averaged network, ready for inference, and its other fields.

    Raises
    ------
    Blur2ViewError
        If there is no checkpoint of this network.
    """
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        network = MotionUNet(MotionOptions(**state["model_options"]))
        network.load_state_dict(state["average"])
    except BAD_CHECKPOINT:
        raise Blur2ViewError(f"{path}: is no checkpoint of python -m tools.training.train_motion") from None
    return network.eval(), state


def main() -> None:
    """Command line."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("examples", type=Path, help="file that tools.training.motion_data wrote")
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--steps", type=int, default=MotionTraining.steps, help="(default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    options = MotionTraining(steps=arguments.steps, seed=arguments.seed)
    try:
        train(MotionExamples.load(arguments.examples), options, arguments.checkpoint)
    except (Blur2ViewError, OSError) as error:
        raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main()
