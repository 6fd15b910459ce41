"""Loops that fit, on problems without geometry: Levenberg-Marquardt, reweighted least squares."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from blur2view.arrays import Array
from blur2view.two_view.least_squares import levenberg_marquardt, reweighted_motion


@dataclass(frozen=True, kw_only=True)
class Valley:
    """Rosenbrock's valley: residuals 10 (y - x^2) and 1 - x."""

    at: Array

    @property
    def residual(self) -> Array:
        """Both residuals."""
        x, y = self.at
        return np.array([10 * (y - x * x), 1 - x])

    @property
    def cost(self) -> float:
        """Sum of their squares."""
        return float(self.residual @ self.residual)

    def normal_equations(self) -> tuple[Array, Array]:
        """Return them."""
        jacobian = np.array([[-20 * self.at[0], -1.0], [10.0, 0.0]])
        return jacobian @ jacobian.T, jacobian @ self.residual

    def moved(self, delta: Array) -> Valley:
        """Return the point moved."""
        return replace(self, at=self.at + delta)


START = Valley(at=np.array([-1.2, 1.0]))


def test_it_follows_a_curved_valley_and_never_climbs() -> None:
    points = list(levenberg_marquardt(START, 40))
    costs = [point.cost for point in points]
    assert costs == sorted(costs, reverse=True)
    assert np.allclose(points[-1].at, 1.0, atol=1e-6)


MOTION = np.array([0.3, -1.2, 0.7])


def flows(seed: int) -> tuple[Array, Array]:
    """Return rows (3, 2, N) and the flow (2, N) of MOTION, a share of it replaced."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(3, 2, 200))
    flow = np.einsum("k,kdn->dn", MOTION, rows)
    wrong = rng.random(200) < 0.3
    flow[:, wrong] = 3 * rng.normal(size=(2, int(wrong.sum())))
    return rows, flow


def by_median(missed: Array) -> Array:
    return np.asarray(np.median(missed, axis=-1, keepdims=True) + 1e-9)


def test_outliers_do_not_move_it() -> None:
    rows, flow = flows(0)
    plain = np.linalg.lstsq(rows.reshape(3, -1).T, flow.ravel(), rcond=None)[0]
    motion, missed = reweighted_motion(rows, flow, steps=20, scale=by_median)
    assert np.abs(motion - MOTION).max() < 1e-6 < np.abs(plain - MOTION).max()
    assert np.isclose(np.median(missed), 0, atol=1e-6)
