"""One optimiser step and one checkpoint for the trainings that can be stopped and resumed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from tools.training.schedule import follow


@dataclass(kw_only=True)
class TrainingRun:
    """What a training has come to after so many steps: weights, and their moving average, which ships."""

    network: nn.Module
    average: nn.Module
    optimiser: torch.optim.Optimizer
    step: int = 0

    def descend(self, loss: Tensor, rate: float, largest_gradient: float) -> float:
        """Make one step down a loss at a learning rate, the gradient's norm bounded; return the loss."""
        for group in self.optimiser.param_groups:
            group["lr"] = rate * group.get("factor", 1.0)
        self.optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), largest_gradient)
        self.optimiser.step()
        self.step += 1
        follow(self.average, self.network, self.step)
        return float(loss.detach())

    def restore(self, path: Path) -> dict[str, Any]:
        """Go on where a checkpoint stands; return all that it holds."""
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step = int(state["step"])
        return state

    def write(self, path: Path, **facts: Any) -> None:
        """Write a checkpoint with further facts; a run killed meanwhile keeps the one before."""
        path.parent.mkdir(parents=True, exist_ok=True)
        state = {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
        }
        temporary = path.with_suffix(".tmp")
        torch.save(state | facts, temporary)
        temporary.replace(path)
