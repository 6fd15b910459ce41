"""Positive depth says which order a smear has: against exact scenes."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.depth import order_log_odds, parallax_along_lines
from blur2view.geometry.rotation import rotation_vector
from tests.support.scenes import make_scene


def parallax(seed: int, rotation_share: float) -> tuple[Array, Array, np.ndarray]:
    """Parallax of both orders of an exact scene's smears, and which smears are swapped."""
    scene = make_scene(np.random.default_rng(seed), rotation_share=rotation_share)
    ends = scene.camera.rays(scene.ends)
    middle, displacement = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    return *parallax_along_lines(rotation_vector(scene.R), scene.t, middle, displacement), scene.swapped


@pytest.mark.parametrize("rotation_share", [0.0, 0.5, 2.0])
def test_points_in_front_have_positive_parallax_in_their_true_order(rotation_share: float) -> None:
    for seed in range(5):
        forward, backward, swapped = parallax(seed, rotation_share)
        assert (np.where(swapped, backward, forward) > 0).mean() > 0.995


def test_translation_alone_decides_every_order() -> None:
    for seed in range(5):
        forward, backward, swapped = parallax(seed, 0.0)
        ahead, behind = order_log_odds(np.stack([forward, backward]), np.full(len(forward), 1e-5))
        assert ((ahead < behind) == swapped).mean() > 0.995
        assert np.allclose(forward, -backward)


def test_exchanging_the_ends_exchanges_the_orders() -> None:
    rng = np.random.default_rng(0)
    turn, t, middle, displacement = rng.normal(size=3), rng.normal(size=3), *rng.normal(size=(2, 9, 2))
    assert np.allclose(
        parallax_along_lines(turn, t, middle, displacement)[::-1],
        parallax_along_lines(turn, t, middle, -displacement),
    )


def test_feasible_orders_share_and_infeasible_ones_are_improbable() -> None:
    sigma = np.ones(1)
    both = order_log_odds(np.array([[50.0], [50.0]]), sigma)
    assert np.allclose(both, np.log(0.5))
    assert np.allclose(order_log_odds(np.array([[50.0], [-50.0]]), sigma)[0], 0)
    assert max(order_log_odds(np.array([[-9.0], [-9.0]]), sigma)) < -10


def test_the_midpoint_at_the_epipole_says_nothing_and_fails_nothing() -> None:
    t = np.array([0.0, 0.0, 1.0])
    got = parallax_along_lines(np.zeros(3), t, np.zeros((1, 2)), np.ones((1, 2)))
    assert np.isfinite(got).all()
