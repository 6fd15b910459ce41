"""The schedule of all trainings: a linear warm-up, then a cosine; and the moving average of their weights."""

import math

import torch
from torch import nn


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
