"""Levenberg-Marquardt and reweighted least squares: loops that fit, which know no geometry.

SciPy's ``least_squares`` takes residuals of fixed weights; here weights change at every point. Given the
square roots of the costs as residuals it ends as low in 1.4 ("lm") to 2 times ("trf") the time (20 scenes of
the sweep of `tools.evaluation.estimators`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import Protocol, Self, TypeVar

import numpy as np

from blur2view.arrays import TINY, AnyArray, Array

# Damping, relative to the diagonal of the normal equations: a tenth after a step that succeeds, ten times
# after one that fails.
FIRST_DAMPING, MIN_DAMPING, MAX_DAMPING = 1e-3, 1e-9, 1e6
RIDGE = 1e-9  # of the normal equations' diagonal, added to it: singular problems have some solution


class Problem(Protocol):
    """A point of a least-squares problem, at which it states its own weights."""

    @property
    def cost(self) -> float:
        """The cost to be minimised."""

    def normal_equations(self) -> tuple[Array, Array]:
        """Return J^T W J (k, k) and J^T W r (k,) of Jacobian, weights and residuals."""

    def moved(self, delta: Array) -> Self:
        """Return the point moved by delta (k,) along its tangents."""


P = TypeVar("P", bound=Problem)


def levenberg_marquardt(
    start: P, max_iterations: int, tolerance: float = 0.0, min_step: float = 0.0
) -> Iterator[P]:
    """Yield the start, then every point reached, by the first step of growing damping that costs no more.

    Ends after ``max_iterations`` steps, where no step succeeds, after a decrease of the cost by a share of at
    most ``tolerance`` or a step shorter than ``min_step`` standard deviations of the parameters.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd ed., appendix A6.2; the scaled damping is Marquardt's.
    """
    yield start
    point, damping = start, FIRST_DAMPING
    for _ in range(max_iterations):
        normal, gradient = point.normal_equations()
        scale = np.diag(normal.diagonal() + 1e-12)
        while damping < MAX_DAMPING:
            delta = np.asarray(np.linalg.solve(normal + damping * scale, -gradient), float)
            trial = point.moved(delta)
            if trial.cost <= point.cost:
                break
            damping *= 10
        else:
            return
        damping = max(damping / 10, MIN_DAMPING)
        converged = point.cost - trial.cost <= tolerance * trial.cost
        point = trial
        yield point
        if converged or delta @ normal @ delta < min_step**2:
            return


def race(
    starts: Sequence[P],
    kept: Sequence[int],
    max_iterations: int,
    tolerance: float = 0.0,
    min_step: float = 0.0,
) -> P:
    """Return the point that `levenberg_marquardt` reaches from the best of several starts.

    They race: for each number of ``kept`` in turn that many of the cheapest points take a step; then the
    cheapest alone goes on.
    """
    runs = [levenberg_marquardt(start, max_iterations, tolerance, min_step) for start in starts]
    trials = [(next(run), run) for run in runs]
    for count in kept if len(runs) > 1 else ():
        trials = sorted(trials, key=lambda trial: trial[0].cost)[:count]
        trials = [(next(run, point), run) for point, run in trials]
    point, run = min(trials, key=lambda trial: trial[0].cost)
    return last_point(chain([point], run))


def last_point(points: Iterable[P]) -> P:
    """Return the last of the points that a fit reaches."""
    return deque(points, maxlen=1).pop()


def reweighted_motion(
    rows: AnyArray,
    flow: AnyArray,
    *,
    steps: int,
    scale: Callable[[AnyArray], AnyArray | float],
    start: Array | None = None,
) -> tuple[AnyArray, AnyArray]:
    """Return the motion m (..., k) with m @ rows = flow for most points, and lengths of residuals (..., N).

    Iteratively reweighted least squares with Cauchy's weights, ``steps`` rounds, of rows (..., k, d, N) and a
    flow (..., d, N); each index of the leading axes is a problem of its own. ``scale`` maps the lengths of
    the residuals (..., N) to the length at which a point has half of its full weight. The first round weighs
    points by their residuals at the ``start`` (..., k), without one it weighs them equally.
    """
    flat = rows.reshape(*rows.shape[:-2], -1)  # (..., k, d N)
    column = flow.reshape(*flow.shape[:-2], -1, 1)  # (..., d N, 1)

    def lengths(motion: AnyArray) -> AnyArray:
        residuals = (motion[..., None, :] @ flat).reshape(flow.shape) - flow
        scalar = flow.shape[-2] == 1
        return np.asarray(np.abs(residuals[..., 0, :]) if scalar else np.linalg.norm(residuals, axis=-2))

    def weights(residuals: AnyArray) -> AnyArray:  # 1 / scale^2 where residuals are zero
        return np.asarray(1 / (np.asarray(scale(residuals)) ** 2 + residuals**2))

    weight: AnyArray = np.ones((*rows.shape[:-3], rows.shape[-1]), rows.dtype)
    if start is not None:
        weight = weights(lengths(start))
    for _ in range(steps):
        weighted = flat * np.concatenate([weight] * flow.shape[-2], axis=-1)[..., None, :]
        normal = weighted @ np.swapaxes(flat, -1, -2)
        ridge = RIDGE * np.diagonal(normal, axis1=-2, axis2=-1) + TINY
        damped = normal + ridge[..., None] * np.eye(ridge.shape[-1])
        motion = np.linalg.solve(damped, weighted @ column)[..., 0].astype(rows.dtype)
        residuals = lengths(motion)
        weight = weights(residuals)
    return motion, residuals
