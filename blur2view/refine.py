"""Local optimisation: decide each match's order, take a robust sigma-weighted Sampson step, repeat."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from blur2view.epipolar import TINY, Array, homogeneous
from blur2view.manifold import Manifold

M = TypeVar("M", bound=Manifold)


@dataclass(frozen=True, kw_only=True)
class RefineOptions:
    """How `refine` works.

    ``max_iterations`` steps at most; ``cutoff`` the residual, in standard deviations, beyond which a match's pull
    falls off (Geman-McClure); ``data_weight`` the share of independent matches (effective over actual number), which
    tempers the data against the prior; ``tolerance`` the relative decrease of the cost that ends the search.
    """

    max_iterations: int = 20
    cutoff: float = 3.0
    data_weight: float = 1.0
    tolerance: float = 1e-5

    def __post_init__(self) -> None:
        """Refuse options out of range."""
        if self.max_iterations < 0 or not self.cutoff > 0 or not 0 < self.data_weight <= 1:
            raise ValueError(f"need max_iterations >= 0, cutoff > 0, 0 < data_weight <= 1, got {self}")


def signed_sampson(F: Array, points1: Array, points2: Array) -> Array:
    """Signed Sampson distances (N,) of ordered matches to F (3, 3): the root of `epipolar.sampson`, with a sign."""
    return _residual_parts(F, homogeneous(points1), homogeneous(points2))[0]


def sampson_jacobian(F: Array, points1: Array, points2: Array) -> Array:
    """Derivative of `signed_sampson` in the nine entries of F, shape (N, 3, 3)."""
    x, y = homogeneous(points1), homogeneous(points2)
    residual, line1, line2, root = _residual_parts(F, x, y)
    scaled = (residual / root)[:, None]  # c / D
    line1, line2 = line1 * scaled, line2 * scaled
    line1[:, 2] = line2[:, 2] = 0.0
    jacobian = (y - line2)[:, :, None] * x[:, None, :] - y[:, :, None] * line1[:, None, :]
    weighted: Array = jacobian / root[:, None, None]
    return weighted


def _residual_parts(F: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Signed residual (N,), lines in view 1 and 2 (N, 3), root of the squared gradient (N,)."""
    line2, line1 = x @ F.T, y @ F
    squared = (line2[:, :2] ** 2).sum(1) + (line1[:, :2] ** 2).sum(1)
    root = np.sqrt(np.maximum(squared, TINY))
    return (line2 * y).sum(1) / root, line1, line2, root


@dataclass(frozen=True, kw_only=True)
class WeightedEnds:
    """Smears in the coordinates of a manifold, with the standard deviations (N,) of their Sampson distance there."""

    ends: Array  # (N, 2, 2)
    sigma: Array  # (N,)

    def ordered(self, F: Array) -> tuple[Array, Array, Array]:
        """Order every match by F: homogeneous points1, points2 (N, 3) and the signed residual in sigmas (N,)."""
        one, other = homogeneous(self.ends[:, 0]), homogeneous(self.ends[:, 1])
        forward, backward = (_residual_parts(F, *pair)[0] for pair in ((one, other), (other, one)))
        swap = np.abs(backward) < np.abs(forward)
        first, second = np.where(swap[:, None], other, one), np.where(swap[:, None], one, other)
        return first, second, np.where(swap, backward, forward) / self.sigma


def refine(start: M, matches: WeightedEnds, options: RefineOptions) -> tuple[M, float]:
    """Minimise data_weight * sum rho(residual / sigma) + |prior|^2 over a family of F by Levenberg-Marquardt.

    The order of every match is decided anew at every point, so the cost is that of SErrMin.
    rho is Geman-McClure's, r^2 / (1 + r^2 / cutoff^2).

    Returns
    -------
    point : Manifold
        The best point met; ``start`` where nothing is better.
    cost : float
        Its cost, dimensionless (twice a negative log-likelihood).
    """
    point, damping = start, 1e-3
    first, second, residual = matches.ordered(point.matrix())
    cost = _cost(point, residual, options)
    for _ in range(options.max_iterations):
        normal, gradient = _normal_equations(point, matches.sigma, (first, second, residual), options)
        improved = False
        while damping < 1e6:
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), -gradient)
            trial = point.step(step)
            trial_order = matches.ordered(trial.matrix())
            trial_cost = _cost(trial, trial_order[2], options)
            if trial_cost < cost:
                improved, damping = True, max(damping / 10, 1e-9)
                break
            damping *= 10
        if not improved:
            break
        gain, point, cost = cost - trial_cost, trial, trial_cost
        first, second, residual = trial_order
        if gain < options.tolerance * cost:
            break
    return point, cost


def robust_cost(residual: Array, cutoff: float) -> Array:
    """Geman-McClure r^2 / (1 + r^2 / cutoff^2): r^2 when small, cutoff^2 at most."""
    squared = residual**2
    bounded: Array = squared / (1 + squared / cutoff**2)
    return bounded


def robust_weight(residual: Array, cutoff: float) -> Array:
    """Weight (1 + r^2 / cutoff^2)^-2 of the reweighted least squares of `robust_cost`."""
    weight: Array = 1 / (1 + residual**2 / cutoff**2) ** 2
    return weight


def _cost(point: Manifold, residual: Array, options: RefineOptions) -> float:
    prior, _ = point.prior()
    return float(options.data_weight * robust_cost(residual, options.cutoff).sum() + prior @ prior)


def _normal_equations(
    point: Manifold, sigma: Array, ordered: tuple[Array, Array, Array], options: RefineOptions
) -> tuple[Array, Array]:
    """J^T W J (k, k) and J^T W r (k,) of data and prior."""
    first, second, residual = ordered
    jacobian = sampson_jacobian(point.matrix(), first[:, :2], second[:, :2]).reshape(-1, 9)
    tangent = point.tangent().reshape(point.dimension, 9)
    J = (jacobian @ tangent.T) / sigma[:, None]  # (N, k)
    weighted = J * (options.data_weight * robust_weight(residual, options.cutoff))[:, None]
    prior, prior_jacobian = point.prior()
    return weighted.T @ J + prior_jacobian.T @ prior_jacobian, weighted.T @ residual + prior_jacobian.T @ prior
