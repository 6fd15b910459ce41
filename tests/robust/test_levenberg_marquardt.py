"""The Levenberg-Marquardt loop on problems without geometry."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from blur2view.arrays import Array
from blur2view.robust.levenberg_marquardt import levenberg_marquardt, normal_equations


@dataclass(frozen=True, kw_only=True)
class Valley:
    """Rosenbrock's valley: residuals 10 (y - x^2) and 1 - x; ``uphill`` takes every step the wrong way."""

    at: Array
    weight: float = 1.0
    uphill: bool = False

    @property
    def residual(self) -> Array:
        """Both residuals."""
        x, y = self.at
        return np.array([10 * (y - x * x), 1 - x])

    @property
    def cost(self) -> float:
        """Sum of their squares, weighted."""
        return self.weight * float(self.residual @ self.residual)

    def normal_equations(self) -> tuple[Array, Array]:
        """Return them without a prior."""
        jacobian = np.array([[-20 * self.at[0], -1.0], [10.0, 0.0]])
        weight = np.full(2, self.weight)
        return normal_equations(jacobian, self.residual, weight, np.zeros(0), np.zeros((0, 2)))

    def moved(self, delta: Array) -> Valley:
        """Return the point moved."""
        return replace(self, at=self.at + (-delta if self.uphill else delta))

    def reweighted(self) -> Valley:
        """Return the point with another weight."""
        return replace(self, weight=2.0)


def test_it_follows_a_curved_valley_and_never_climbs() -> None:
    steps = list(levenberg_marquardt(Valley(at=np.array([-1.2, 1.0])), 40))
    assert all(step.decrease >= 0 for step in steps)
    assert np.allclose(steps[-1].point.at, 1.0, atol=1e-6)


def test_a_step_is_judged_by_the_weights_before_it_and_then_reweighted() -> None:
    first = next(levenberg_marquardt(Valley(at=np.array([-1.2, 1.0])), 1))
    assert first.point.weight == 2.0
    assert np.isclose(first.point.cost, 2 * first.cost)


def test_the_length_of_a_step_is_in_standard_deviations() -> None:
    start = Valley(at=np.array([0.999, 0.998]))
    step = next(levenberg_marquardt(start, 1))
    normal, _ = start.normal_equations()
    delta = step.point.at - start.at
    assert np.isclose(step.sigmas, np.sqrt(delta @ normal @ delta))


def test_it_ends_where_no_step_lowers_the_cost() -> None:
    assert not list(levenberg_marquardt(Valley(at=np.array([-1.2, 1.0]), uphill=True), 5))


def test_normal_equations_add_the_prior() -> None:
    rng = np.random.default_rng(0)
    J, residual, weight = rng.normal(size=(3, 9)), rng.normal(size=9), rng.uniform(size=9)
    prior, prior_jacobian = rng.normal(size=2), rng.normal(size=(2, 3))
    normal, gradient = normal_equations(J, residual, weight, prior, prior_jacobian)
    W = np.diag([*weight, 1.0, 1.0])
    stacked = np.concatenate([J.T, prior_jacobian])
    assert np.allclose(normal, stacked.T @ W @ stacked)
    assert np.allclose(gradient, stacked.T @ W @ np.concatenate([residual, prior]))
