"""Solvers by others find F when given the order; the paper's minimises its cost."""

from functools import partial

import numpy as np
import pytest

from blur2view.geometry.epipolar import homogeneous, unit_norm
from tests.support.scenes import disturb, make_scene
from tools.evaluation import baselines
from tools.metrics import rho

SCENE = disturb(
    make_scene(np.random.default_rng(0), count=600, length_px=30, rotation_share=0.8),
    np.random.default_rng(1),
    noise_px=0.05,
)
SOLVERS = baselines.ORDERED | {"PoseLib, K": partial(baselines.poselib_calibrated, K=SCENE.K)}


@pytest.mark.parametrize("name", SOLVERS)
def test_a_solver_given_the_order_finds_F_and_its_direction_in_time(name: str) -> None:
    ends = np.stack(SCENE.ordered, axis=1)
    F, backwards = (baselines.solve(SOLVERS[name], e) for e in (ends, ends[:, ::-1]))
    assert F is not None and backwards is not None
    assert np.median(rho(F, SCENE.true_ends)) < 0.01
    for other in (SCENE.F, backwards.T):
        assert abs((unit_norm(F) * unit_norm(other)).sum()) > 0.99


def test_two_parameters_are_the_F_of_a_pure_translation() -> None:
    scene = make_scene(np.random.default_rng(4), count=300, rotation_share=0.0)
    F = baselines.two_parameter_fundamental(scene.matches(0.2))
    assert F is not None and np.median(rho(F, scene.true_ends)) < 1e-3


def test_the_papers_cost_is_the_sum_of_the_lesser_residuals_of_F_and_its_transpose() -> None:
    rng = np.random.default_rng(0)
    ends, F = rng.normal(size=(7, 2, 2)), rng.normal(size=(3, 3))
    x, y = homogeneous(ends[:, 0]), homogeneous(ends[:, 1])
    forward, backward = (np.einsum("ni,ij,nj->n", y, matrix, x) for matrix in (F, F.T))
    rows = baselines.constraint_rows(ends)
    cost, gradient = baselines.ambiguous_cost(F.ravel(), *rows)
    assert np.isclose(cost, (np.minimum(np.abs(forward), np.abs(backward)) ** 2).sum())
    moved, _ = baselines.ambiguous_cost(F.ravel() + 1e-6 * gradient, *rows)
    assert np.isclose(moved - cost, 1e-6 * gradient @ gradient, rtol=1e-3)


def test_the_papers_estimator_is_the_same_again_has_rank_two_and_needs_enough_smears() -> None:
    matches = make_scene(np.random.default_rng(6), count=100).matches(1.0)
    one, two = (baselines.paper_of_matches(matches, max_iterations=5) for _ in range(2))
    assert one is not None and two is not None and one.tobytes() == two.tobytes()
    assert abs(np.linalg.det(one)) < 1e-12
    assert baselines.paper_of_matches(matches.subset(np.arange(19)), max_iterations=5) is None
