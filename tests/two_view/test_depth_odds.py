"""Positive depth says which order a smear has: against exact scenes."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.rotation import rotation_vector
from blur2view.two_view.likelihood import DepthOdds
from tests.support.scenes import make_scene


def odds(seed: int, rotation_share: float, along: float = 1e-5) -> tuple[Array, np.ndarray]:
    """Odds of both orders of an exact scene's smears, and which smears are swapped."""
    scene = make_scene(np.random.default_rng(seed), rotation_share=rotation_share)
    ends = scene.camera.rays(scene.ends)
    depths = DepthOdds.of(ends.mean(axis=1), ends[:, 1] - ends[:, 0], np.full(len(ends), along))
    return depths.at(rotation_vector(scene.R), scene.t, 1.0), scene.swapped


@pytest.mark.parametrize("rotation_share", [0.0, 0.5, 2.0])
def test_points_in_front_are_feasible_in_their_true_order(rotation_share: float) -> None:
    decided = 0.0
    for seed in range(5):
        (forward, backward), swapped = odds(seed, rotation_share)
        true, other = np.where(swapped, (backward, forward), (forward, backward))
        told = np.abs(true - other) > 0.02
        decided += told.mean() / 5
        assert (true > 0.49).mean() > 0.99 and (true > other)[told].all()
    assert decided > 0.5


def test_translation_alone_decides_every_order() -> None:
    for seed in range(5):
        (forward, backward), swapped = odds(seed, 0.0)
        assert ((forward < backward) == swapped).mean() > 0.995


def test_exchanging_the_ends_or_the_translation_exchanges_the_orders() -> None:
    rng = np.random.default_rng(0)
    turn, t, middle, displacement = rng.normal(size=3), rng.normal(size=3), *rng.normal(size=(2, 9, 2))
    one, other = (DepthOdds.of(middle, s * displacement, np.ones(9)) for s in (1, -1))
    assert np.allclose(one.at(turn, t, 1.0)[::-1], other.at(turn, t, 1.0))
    assert np.allclose(one.at(0 * turn, t, -1.0), other.at(0 * turn, t, 1.0))
    assert np.allclose(one.at(turn, t, -1.0), one.at(turn, -t, 1.0))


def test_feasible_orders_share_and_infeasible_ones_are_improbable() -> None:
    middle, sideways = np.zeros((1, 2)), np.array([1.0, 0.0, 0.0])
    turn = np.array([0.0, 1.0, 0.0])  # moves the centre by 1 along x
    depths = DepthOdds.of(middle, np.array([[0.1, 0.0]]), np.array([0.01]))
    assert np.allclose(depths.at(-turn, sideways, 1.0), 0.5)
    assert np.allclose(depths.at(0 * turn, sideways, 1.0), [[1.0], [0.0]], atol=1e-6)
    assert depths.at(turn, sideways, 1.0).max() < np.exp(-10)


def test_the_midpoint_at_the_epipole_says_nothing_and_fails_nothing() -> None:
    depths = DepthOdds.of(np.zeros((1, 2)), np.ones((1, 2)), np.ones(1))
    forward, backward = depths.at(np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0)
    assert forward == backward > 0
