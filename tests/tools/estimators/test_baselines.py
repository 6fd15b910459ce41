"""Solvers by others: they find F when given the order, and the orders they are given are what they say."""

import numpy as np
import pytest

from blur2view.arrays import Array
from tests.support.scenes import disturb, make_scene
from tools.estimators import baselines
from tools.metrics import rho

SOLVERS = [
    baselines.opencv_magsac,
    baselines.opencv_accurate,
    baselines.pycolmap_ransac,
    baselines.poselib_ransac,
]


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: str(solver.__name__))
def test_solver_told_the_order_finds_F_and_its_direction_in_time(solver: baselines.Solver) -> None:
    rng = np.random.default_rng(0)
    scene = disturb(make_scene(rng, count=600, length_px=30, rotation_share=0.8), rng, noise_px=0.05)
    F = baselines.solve(solver, np.stack(scene.ordered, axis=1))
    backwards = baselines.solve(solver, np.stack(scene.ordered[::-1], axis=1))
    assert F is not None and backwards is not None
    assert np.median(rho(F, scene.true_ends)) < 0.01
    same, transposed = (abs((F / np.linalg.norm(F) * other / np.linalg.norm(other)).sum())
                        for other in (scene.F, backwards.T))  # fmt: skip
    assert same > 0.99 and transposed > 0.99


def test_solver_told_order_and_camera_finds_F() -> None:
    rng = np.random.default_rng(0)
    scene = disturb(make_scene(rng, count=600, length_px=30, rotation_share=0.8), rng, noise_px=0.5)
    F = baselines.poselib_calibrated(*scene.ordered, scene.K)
    assert np.median(rho(F, scene.true_ends)) < 0.01 and abs((F * scene.F).sum()) > 0.99


def test_two_parameters_are_the_F_of_a_pure_translation() -> None:
    scene = make_scene(np.random.default_rng(4), count=300, rotation_share=0.0)
    matches = scene.matches(0.2)
    F = baselines.two_parameter_fundamental(matches)
    assert F is not None and np.median(rho(F, scene.true_ends)) < 1e-3
    assert baselines.two_parameter_fundamental(matches.subset(np.arange(19))) is None


def test_orders_are_those_of_the_displacement_and_never_to_the_left() -> None:
    scene = make_scene(np.random.default_rng(1), count=100)
    open_end, close_end = scene.ordered
    ordered = baselines.in_true_order(scene.ends, close_end - open_end)
    np.testing.assert_array_equal(ordered, np.stack([open_end, close_end], axis=1))
    rightward = baselines.rightward(scene.ends)
    assert (rightward[:, 1, 0] >= rightward[:, 0, 0]).all()
    np.testing.assert_array_equal(np.sort(rightward, axis=1), np.sort(scene.ends, axis=1))


def test_scrambling_turns_half_of_the_smears_and_repeats() -> None:
    ends = make_scene(np.random.default_rng(3), count=1000).ends
    first, again = (baselines.scrambled(ends, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    turned = (first != ends).any(axis=(1, 2))
    np.testing.assert_array_equal(first[turned], ends[turned][:, ::-1])
    assert 0.45 < turned.mean() < 0.55


@pytest.mark.parametrize("answer", [None, np.zeros((3, 3)), np.full((3, 3), np.nan)])
def test_answer_that_is_no_matrix_is_none(answer: Array | None) -> None:
    ends = make_scene(np.random.default_rng(5), count=20).ends
    assert baselines.solve(lambda one, other: answer, ends) is None
    assert baselines.solve(lambda one, other: pytest.fail("too few"), ends[:7]) is None
