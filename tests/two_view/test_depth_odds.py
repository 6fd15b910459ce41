"""Positive depth says which order a smear has: against exact scenes."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.rotation import rotation_vector
from blur2view.two_view.likelihood import Likelihood
from tests.support.likelihoods import normalised_likelihood
from tests.support.scenes import make_scene


def smears(middle: Array, displacement: Array) -> Likelihood:
    """Return the likelihood of smears (N, 2) at normalised midpoints (N, 2), all independent."""
    return normalised_likelihood(
        np.stack([middle - displacement / 2, middle + displacement / 2], axis=1), 1e-4
    )


def odds(seed: int, rotation_share: float) -> tuple[Array, np.ndarray]:
    """Return odds of both orders of an exact scene's smears, and which smears are swapped."""
    scene = make_scene(np.random.default_rng(seed), rotation_share=rotation_share)
    likelihood = Likelihood.of(scene.matches(0.01), scene.camera)
    return likelihood.order_odds(rotation_vector(scene.R), scene.t, 1.0), scene.swapped


@pytest.mark.parametrize("rotation_share", [0.0, 0.3, 0.6])
def test_points_in_front_are_likelier_in_their_true_order(rotation_share: float) -> None:
    decided = 0.0
    for seed in range(5):
        (forward, backward), swapped = odds(seed, rotation_share)
        true, other = np.where(swapped, (backward, forward), (forward, backward))
        clear = np.abs(true - other) > 0.3
        decided += clear.mean() / 5
        assert (true > other)[clear].mean() > 0.999
    assert decided > 0.3


def test_translation_alone_decides_every_order() -> None:
    for seed in range(5):
        (forward, backward), swapped = odds(seed, 0.0)
        assert ((forward < backward) == swapped).mean() > 0.995


def test_exchanging_the_ends_or_the_translation_exchanges_the_orders() -> None:
    rng = np.random.default_rng(0)
    turn, t, middle, displacement = rng.normal(size=3), rng.normal(size=3), *rng.normal(size=(2, 9, 2))
    one, other = (smears(middle, s * displacement) for s in (1, -1))
    assert np.allclose(one.order_odds(turn, t, 1.0)[::-1], other.order_odds(turn, t, 1.0))
    assert np.allclose(one.order_odds(0 * turn, t, -1.0), other.order_odds(0 * turn, t, 1.0))
    assert np.allclose(one.order_odds(turn, t, -1.0), one.order_odds(turn, -t, 1.0))


def test_feasible_orders_share_and_infeasible_ones_are_improbable() -> None:
    sideways, turn = (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))  # by 1 along x
    likelihood = smears(np.zeros((1, 2)), np.array([[0.1, 0.0]]))
    assert np.allclose(likelihood.order_odds(-turn, sideways, 1.0), 0.5, atol=0.01)
    forward, backward = likelihood.order_odds(0 * turn, sideways, 1.0)
    assert forward > 0.95 and backward < 1e-6
    assert likelihood.order_odds(turn, sideways, 1.0).max() < np.exp(-10)


def test_the_midpoint_at_the_epipole_says_nothing_and_fails_nothing() -> None:
    forward, backward = smears(np.zeros((1, 2)), np.ones((1, 2))).order_odds(
        np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0
    )
    assert forward == backward > 0
