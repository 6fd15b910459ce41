"""Levenberg-Marquardt on reweighted least squares: the one loop that fits, which knows no geometry."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol, Self, TypeVar

import numpy as np

from blur2view.arrays import Array

# Damping, relative to the diagonal of the normal equations: a tenth after a step that succeeds, ten times
# after one that fails.
FIRST, LEAST, GREATEST = 1e-3, 1e-9, 1e6


class Problem(Protocol):
    """A point of a least-squares problem whose weights are those of the point."""

    @property
    def cost(self) -> float:
        """What is to be least."""

    def normal_equations(self) -> tuple[Array, Array]:
        """Return J^T W J (k, k) and J^T W r (k,) of Jacobian, weights and residuals."""

    def moved(self, delta: Array) -> Self:
        """Return the point moved by delta (k,) along its tangents."""


P = TypeVar("P", bound=Problem)


def levenberg_marquardt(
    start: P, max_iterations: int, tolerance: float = 0.0, rest: float = 0.0
) -> Iterator[P]:
    """Yield the start, then the points reached, each by the step of least damping tried that costs no more.

    Ends after ``max_iterations`` steps, where no step succeeds, after a decrease of the cost by a share of at
    most ``tolerance`` or a step shorter than ``rest`` standard deviations of the parameters.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd ed., appendix A6.2; the scaled damping is Marquardt's.
    """
    yield start
    point, damping = start, FIRST
    for _ in range(max_iterations):
        normal, gradient = point.normal_equations()
        diagonal, scale = np.eye(len(gradient), dtype=bool), normal.diagonal() + 1e-12
        while damping < GREATEST:
            damped = normal.copy()
            damped[diagonal] += damping * scale
            delta = np.asarray(np.linalg.solve(damped, -gradient), float)
            trial = point.moved(delta)
            if trial.cost <= point.cost:
                break
            damping *= 10
        else:
            return
        damping = max(damping / 10, LEAST)
        little = point.cost - trial.cost <= tolerance * trial.cost
        point = trial
        yield point
        if little or delta @ normal @ delta < rest**2:
            return


def least_of(
    starts: Sequence[P], kept: Sequence[int], max_iterations: int, tolerance: float = 0.0, rest: float = 0.0
) -> P:
    """Return the point reached by `levenberg_marquardt` from the best of several starts.

    They race: of the cheapest so many as ``kept`` says each takes a step, again for each of its numbers; then
    the one that is cheapest goes on.
    """
    runs = [levenberg_marquardt(start, max_iterations, tolerance, rest) for start in starts]
    trials = [(next(run), run) for run in runs]
    for count in kept if len(runs) > 1 else ():
        trials = sorted(trials, key=lambda trial: trial[0].cost)[:count]
        trials = [(next(run, reached), run) for reached, run in trials]
    reached, run = min(trials, key=lambda trial: trial[0].cost)
    *_, best = [reached, *run]
    return best
