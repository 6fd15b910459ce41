"""The state of a training run: networks, optimiser, step; saved whole, resumed exactly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import nn

from tools.training.model import ModelOptions, SmearUNet

PATHS = ("train", "val", "out", "weights")
"""Options that name folders of the machine that trained."""


@dataclass
class Run:
    """What a checkpoint holds.

    Attributes
    ----------
    network, average : SmearUNet
        The trained weights, and their moving average, which is what ships.
    optimiser : torch.optim.Optimizer
        Over the parameters of `network`.
    step : int
        Optimiser steps done.
    steps_before : int
        Steps of the earlier runs whose weights this one started from.
    figures : dict of float
        Those of the last validation.
    """

    network: SmearUNet
    average: SmearUNet
    optimiser: torch.optim.Optimizer
    step: int = 0
    steps_before: int = 0
    figures: dict[str, float] = field(default_factory=dict)

    def save(self, path: Path, options: Mapping[str, Any], scenes: int) -> None:
        """Write the checkpoint with the run's options and number of scenes.

        A run killed meanwhile keeps the checkpoint before.
        """
        state = {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "steps_before": self.steps_before,
            "model_options": self.network.options.as_dict(),
            "options": {k: str(v) if isinstance(v, Path) else v for k, v in options.items()},
            "figures": self.figures,
            "scenes": scenes,
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
        self.step, self.steps_before = int(state["step"]), int(state["steps_before"])
        self.figures = dict(state["figures"])


def start_run(
    seed: int,
    learning_rate: float,
    device: torch.device,
    last: Path | None = None,
    weights: Path | None = None,
) -> Run:
    """Return a fresh run, or the one in `last` if that file exists.

    A fresh run's weights are the averaged ones of the checkpoint `weights`, or follow from the seed.
    """
    torch.manual_seed(seed)
    network, before = SmearUNet(), 0
    if weights:
        network, state = load_average(weights)
        before = int(state["step"]) + int(state["steps_before"])
    average = SmearUNet(network.options)
    average.load_state_dict(network.state_dict())
    for part in (network, average):
        part.to(device)
        part.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # the stubs lack it
    optimiser = torch.optim.AdamW(network.parameters(), lr=learning_rate, weight_decay=1e-4)
    run = Run(network=network, average=average, optimiser=optimiser, steps_before=before)
    if last is not None and last.exists():
        run.load(last)
    return run


@torch.no_grad()
def follow(average: nn.Module, network: nn.Module, step: int) -> None:
    """Move the exponential average of weights and statistics, over about the last 500 steps."""
    decay = min(0.998, (1 + step) / (10 + step))
    for mean, value in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
        if mean.dtype.is_floating_point:
            mean.lerp_(value, 1 - decay)
        else:
            mean.copy_(value)


def load_average(path: Path) -> tuple[SmearUNet, dict[str, Any]]:
    """Load the averaged network of a checkpoint, ready for inference, and the checkpoint's other fields."""
    state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    network = SmearUNet(ModelOptions.from_dict(state["model_options"]))
    network.load_state_dict(state["average"])
    return network.eval(), state


def save_average(checkpoint: Path, target: Path) -> None:
    """Keep of a checkpoint what inference and a later training need: averaged weights, history, no paths."""
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
    kept = {
        key: state[key] for key in ("average", "model_options", "step", "steps_before", "figures", "scenes")
    }
    kept["options"] = {k: v for k, v in state["options"].items() if k not in PATHS}
    temporary = target.with_suffix(".tmp")
    torch.save(kept, temporary)
    temporary.replace(target)
