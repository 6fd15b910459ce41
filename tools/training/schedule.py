"""The schedule of all trainings: a linear warm-up, then a cosine."""

from __future__ import annotations

import math


def warm_cosine(step: int, steps: int, peak: float, warm_up: int) -> float:
    """Give a step's learning rate: up to the peak linearly, then along a cosine down to 1 % of it.

    Parameters
    ----------
    step, steps : int
        Number of the step, and of all.
    peak : float
    warm_up : int
        Steps of the warm-up.
    """
    warm = min(1.0, (step + 1) / max(1, warm_up))
    fall = 0.5 * (1 + math.cos(math.pi * min(1.0, step / steps)))
    return peak * warm * (0.01 + 0.99 * fall)
