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

AVERAGED = 500
"""Steps over which the weights that ship are averaged."""


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

    def rate_at(self, step: int) -> float:
        """Return a step's learning rate: to the peak in ``warm_up`` steps, then by a cosine to 1 % of it."""
        warm = min(1.0, (step + 1) / max(1, self.warm_up))
        return self.rate * warm * (0.01 + 0.495 * (1 + math.cos(math.pi * step / self.steps)))


def fit(task: Task, schedule: Schedule) -> dict[str, Any]:
    """Run the schedule to its end; return the last figures of the moving average of the weights, which ships.

    ``last.pt`` stays fresh, figures are printed and lines of ``log.jsonl``. Step k draws its examples by a
    generator of the seed and k.
    """
    s, checkpoint, network = schedule, schedule.out / "last.pt", task.network
    s.out.mkdir(parents=True, exist_ok=True)
    average, optimiser = copy.deepcopy(network), torch.optim.AdamW(network.parameters(), weight_decay=1e-4)
    parts: dict[str, Any] = {"network": network, "average": average, "optimiser": optimiser}
    step, figures, losses = 0, dict[str, Any](), list[float]()
    if checkpoint.exists():
        state: dict[str, Any] = torch.load(checkpoint, map_location="cpu", weights_only=True)
        for name, part in parts.items():
            part.load_state_dict(state[name])
        step, figures = state["step"], state["figures"]
    while step < s.steps:
        network.train()
        loss = task.loss(np.random.default_rng([s.seed, step]), step)
        for group in optimiser.param_groups:
            group["lr"] = s.rate_at(step)
        optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        nn.utils.clip_grad_norm_(network.parameters(), s.largest_gradient)
        optimiser.step()
        step += 1
        follow(average, network, min(1 - 1 / AVERAGED, (1 + step) / (10 + step)))
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


@torch.no_grad()
def follow(average: nn.Module, network: nn.Module, decay: float) -> None:
    """Move the exponential average of weights and statistics."""
    for mean, value in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
        if mean.dtype.is_floating_point:
            mean.lerp_(value, 1 - decay)
        else:
            mean.copy_(value)


def batched(rows: list[Example]) -> dict[str, Tensor]:
    """Return examples stacked, float32."""
    return {key: torch.from_numpy(np.stack([row[key] for row in rows])).float() for key in rows[0]}
