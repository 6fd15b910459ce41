"""Solvers by others: they find F when given the order, and the orders they are given are what they say."""

from functools import partial

import numpy as np
import pytest

from blur2view.geometry.epipolar import unit_norm
from tests.support.scenes import disturb, make_scene
from tools.estimators import baselines
from tools.metrics import rho

SCENE = disturb(
    make_scene(np.random.default_rng(0), count=600, length_px=30, rotation_share=0.8),
    np.random.default_rng(1),
    noise_px=0.05,
)
SOLVERS = baselines.ORDERED | {"poselib calibrated": partial(baselines.poselib_calibrated, K=SCENE.K)}


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
