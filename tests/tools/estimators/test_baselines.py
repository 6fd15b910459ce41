"""Solvers by others: they find F when given the order, and the orders they are given are what they say."""

from functools import partial

import cv2
import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import unit_norm
from tests.support.scenes import disturb, make_scene
from tools.estimators import baselines
from tools.metrics import rho

SCENE = disturb(
    make_scene(np.random.default_rng(0), count=600, length_px=30, rotation_share=0.8),
    np.random.default_rng(1),
    noise_px=0.05,
)
SOLVERS: dict[str, baselines.Solver] = {
    "magsac": baselines.opencv,
    "accurate": partial(baselines.opencv, method=cv2.USAC_ACCURATE),
    "pycolmap": baselines.pycolmap_ransac,
    "poselib": baselines.poselib_ransac,
    "poselib calibrated": partial(baselines.poselib_calibrated, K=SCENE.K),
}


@pytest.mark.parametrize("name", SOLVERS)
def test_solver_told_the_order_finds_F_and_its_direction_in_time(name: str) -> None:
    ends = np.stack(SCENE.ordered, axis=1)
    F, backwards = (baselines.solve(SOLVERS[name], e) for e in (ends, ends[:, ::-1]))
    assert F is not None and backwards is not None
    assert np.median(rho(F, SCENE.true_ends)) < 0.01
    for other in (SCENE.F, backwards.T):
        assert abs((unit_norm(F) * unit_norm(other)).sum()) > 0.99


def test_two_parameters_are_the_F_of_a_pure_translation() -> None:
    scene = make_scene(np.random.default_rng(4), count=300, rotation_share=0.0)
    matches = scene.matches(0.2)
    F = baselines.two_parameter_fundamental(matches)
    assert F is not None and np.median(rho(F, scene.true_ends)) < 1e-3
    assert baselines.two_parameter_fundamental(matches.subset(np.arange(19))) is None


def test_orders_are_those_of_the_displacement_by_chance_and_never_to_the_left() -> None:
    scene = make_scene(np.random.default_rng(1), count=100)
    open_end, close_end = scene.ordered
    ordered = baselines.in_true_order(scene.ends, close_end - open_end)
    np.testing.assert_array_equal(ordered, np.stack([open_end, close_end], axis=1))
    mixed = baselines.scrambled(scene.ends, np.random.default_rng(4))
    turned = (mixed != scene.ends).any(axis=(1, 2))
    np.testing.assert_array_equal(mixed[turned], scene.ends[turned][:, ::-1])
    assert 0.3 < turned.mean() < 0.7
    rightward = baselines.rightward(scene.ends)
    assert (rightward[:, 1, 0] >= rightward[:, 0, 0]).all()
    np.testing.assert_array_equal(np.sort(rightward, axis=1), np.sort(scene.ends, axis=1))


@pytest.mark.parametrize("answer", [None, np.zeros((3, 3)), np.full((3, 3), np.nan)])
def test_answer_that_is_no_matrix_is_none(answer: Array | None) -> None:
    ends = make_scene(np.random.default_rng(5), count=20).ends
    assert baselines.solve(lambda one, other: answer, ends) is None
    assert baselines.solve(lambda one, other: pytest.fail("too few"), ends[:7]) is None
