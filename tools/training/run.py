"""The loop of all trainings: a task gives losses and figures; a stopped run goes on from its checkpoint."""

import copy
import json
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tools.datasets.shards import Example


class Task(ABC):
    """What a training learns: a network, its losses on examples, and facts that the checkpoint states."""

    def __init__(self, network: nn.Module, facts: dict[str, Any]) -> None:
        self.network, self.facts = network, facts

    @abstractmethod
    def loss(self, rng: np.random.Generator, step: int) -> Tensor:
        """Return the loss of a batch."""

    @abstractmethod
    def figures(self, network: nn.Module) -> dict[str, Any]:
        """Return how good a network is on examples that train nothing."""


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """How a training runs: its folder, steps, peak rate, steps between checkpoints with figures."""

    out: Path
    steps: int
    rate: float
    largest_gradient: float
    seed: int
    every: int
    warm_up: int = 200


def fit(task: Task, schedule: Schedule) -> dict[str, Any]:
    """Run the schedule to its end; return the last figures of the moving average of the weights, which ships.

    ``last.pt`` stays fresh, figures are printed and lines of ``log.jsonl``. Step k draws its examples by a
    generator of the seed and k.
    """
    s, checkpoint = schedule, schedule.out / "last.pt"
    s.out.mkdir(parents=True, exist_ok=True)
    network, average = task.network, copy.deepcopy(task.network)
    optimiser = torch.optim.AdamW(network.parameters(), lr=s.rate, weight_decay=1e-4)
    parts: dict[str, Any] = {"network": network, "average": average, "optimiser": optimiser}
    step, figures, losses = 0, dict[str, Any](), list[float]()
    if checkpoint.exists():
        state: dict[str, Any] = torch.load(checkpoint, map_location="cpu", weights_only=True)
        for name, part in parts.items():
            part.load_state_dict(state[name])
        step, figures = int(state["step"]), state.get("figures", {})
    while step < s.steps:
        network.train()
        loss = task.loss(np.random.default_rng([s.seed, step]), step)
        for group in optimiser.param_groups:
            group["lr"] = warm_cosine(step, s.steps, s.rate, s.warm_up)
        optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(network.parameters(), s.largest_gradient)
        optimiser.step()
        step += 1
        follow(average, network, step)
        losses.append(float(loss.detach()))
        if step == s.steps or step % s.every == 0:
            figures = task.figures(average.eval())
            line = json.dumps({"step": step, "loss": round(float(np.mean(losses)), 4), **figures})
            print(line, flush=True)
            with (s.out / "log.jsonl").open("a") as file:
                file.write(line + "\n")
            losses = []
            stored = {name: part.state_dict() for name, part in parts.items()}
            save(checkpoint, stored | {"step": step, "figures": figures} | task.facts)
    return figures


def save(path: Path, state: dict[str, Any]) -> None:
    """Write a checkpoint; a run killed meanwhile keeps the one before."""
    temporary = path.with_suffix(".tmp")
    torch.save(state, temporary)
    temporary.replace(path)


def warm_cosine(step: int, steps: int, peak: float, warm_up: int) -> float:
    """Return a step's learning rate: to the peak in ``warm_up`` steps, then by a cosine down to 1 % of it."""
    warm = min(1.0, (step + 1) / max(1, warm_up))
    fall = 0.5 * (1 + math.cos(math.pi * min(1.0, step / steps)))
    return peak * warm * (0.01 + 0.99 * fall)


@torch.no_grad()
def follow(average: nn.Module, network: nn.Module, step: int) -> None:
    """Move the exponential average of weights and statistics, over about the last 500 steps."""
    decay = min(0.998, (1 + step) / (10 + step))
    for mean, value in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
        if mean.dtype.is_floating_point:
            mean.lerp_(value, 1 - decay)
        else:
            mean.copy_(value)


def batched(rows: list[Example]) -> dict[str, Tensor]:
    """Return examples stacked, float32."""
    return {key: torch.from_numpy(np.stack([row[key] for row in rows])).float() for key in rows[0]}
