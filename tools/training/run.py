"""The loop of all trainings: a task gives losses and figures; a stopped run goes on from its checkpoint."""

import copy
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn

from tools.datasets.shards import Example


class Task(Protocol):
    """What a training learns: a network, and its losses on examples."""

    @property
    def network(self) -> nn.Module:
        """What is trained."""

    groups: list[dict[str, Any]]
    """Parameters as the optimiser takes them; ``factor`` is a group's learning rate over the common one."""
    facts: dict[str, Any]
    """What the checkpoint says besides."""

    def losses(self, rng: np.random.Generator, step: int) -> tuple[Tensor, Tensor]:
        """Return the loss to descend on a batch, and the one to report."""

    def figures(self, network: nn.Module) -> dict[str, Any]:
        """Return how good a network is on examples that train nothing."""


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """How a training runs: its folder, steps, peak rate, steps between checkpoints and between figures."""

    out: Path
    steps: int
    rate: float
    largest_gradient: float
    seed: int
    save_every: int
    validate_every: int
    warm_up: int = 200


@dataclass(kw_only=True)
class TrainingRun:
    """What a training has come to after so many steps: weights, and their moving average, which ships."""

    network: nn.Module
    average: nn.Module
    optimiser: torch.optim.Optimizer
    step: int = 0
    figures: dict[str, Any] = field(default_factory=dict)

    def descend(self, loss: Tensor, rate: float, largest_gradient: float) -> None:
        """Make one step down a loss at a learning rate, the gradient's norm bounded."""
        for group in self.optimiser.param_groups:
            group["lr"] = rate * group.get("factor", 1.0)
        self.optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), largest_gradient)
        self.optimiser.step()
        self.step += 1
        follow(self.average, self.network, self.step)

    def restore(self, path: Path) -> None:
        """Go on where a checkpoint stands."""
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        for name in ("network", "average", "optimiser"):
            getattr(self, name).load_state_dict(state[name])
        self.step, self.figures = int(state["step"]), state.get("figures", {})

    def save(self, path: Path, facts: dict[str, Any]) -> None:
        """Write a checkpoint with further facts; a run killed meanwhile keeps the one before."""
        parts = ("network", "average", "optimiser")
        state = {name: getattr(self, name).state_dict() for name in parts}
        temporary = path.with_suffix(".tmp")
        torch.save(state | {"step": self.step, "figures": self.figures} | facts, temporary)
        temporary.replace(path)


def fit(task: Task, schedule: Schedule) -> TrainingRun:
    """Run the schedule to its end; ``last.pt`` stays fresh, figures are printed and lines of ``log.jsonl``.

    Step k draws its examples by a generator of the seed and k.
    """
    s, checkpoint = schedule, schedule.out / "last.pt"
    s.out.mkdir(parents=True, exist_ok=True)
    optimiser = torch.optim.AdamW(task.groups, lr=s.rate, weight_decay=1e-4)
    run = TrainingRun(network=task.network, average=copy.deepcopy(task.network), optimiser=optimiser)
    if checkpoint.exists():
        run.restore(checkpoint)
    losses: list[float] = []
    while run.step < s.steps:
        run.network.train()
        loss, shown = task.losses(np.random.default_rng([s.seed, run.step]), run.step)
        run.descend(loss, warm_cosine(run.step, s.steps, s.rate, s.warm_up), s.largest_gradient)
        losses.append(float(shown.detach()))
        done = run.step == s.steps
        if done or run.step % s.validate_every == 0:
            run.figures = task.figures(run.average.eval())
            line = json.dumps({"step": run.step, "loss": round(float(np.mean(losses)), 4), **run.figures})
            print(line, flush=True)
            with (s.out / "log.jsonl").open("a") as file:
                file.write(line + "\n")
            losses = []
        if done or run.step % s.save_every == 0:
            run.save(checkpoint, task.facts)
    return run


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


def drawn(shards: list[Example], rng: np.random.Generator) -> Example:
    """Return a random example of one of some shards."""
    shard = shards[int(rng.integers(len(shards)))]
    k = int(rng.integers(len(next(iter(shard.values())))))
    return {name: array[k] for name, array in shard.items()}


def batched(rows: list[Example]) -> dict[str, Tensor]:
    """Return examples stacked, float32."""
    return {key: torch.from_numpy(np.stack([row[key] for row in rows])).float() for key in rows[0]}
