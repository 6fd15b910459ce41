"""Measures against values worked out by hand."""

import numpy as np
import pytest

from tests.support.scenes import make_scene, rotation
from tools import metrics


def test_epe_s_and_direction_are_blind_to_sign() -> None:
    d, truth = np.array([[3.0, 4], [-3, -4], [0, 5], [0, 0]]), np.array([[3.0, 4], [3, 4], [3, 4], [3, 4]])
    assert np.allclose(metrics.epe_s(d, truth), [0, 0, np.sqrt(10), 5])
    expected = [0, 0, np.degrees(np.arccos(0.8)), 0]
    assert np.allclose(metrics.direction_error_deg(d, truth), expected)
    assert np.allclose(metrics.direction_error_deg([1.0, 0], [0.0, -2]), 90)


def test_sparsification_by_hand_and_its_order() -> None:
    assert np.isclose(metrics.sparsification_area([1.0, 3], [2.0, 1], steps=2), 0.5)
    error = np.random.default_rng(0).exponential(size=1000)
    assert metrics.sparsification_area(error, error**2) == 0
    chance = metrics.sparsification_area(error, np.random.default_rng(1).random(1000))
    assert 0 < chance < metrics.sparsification_area(error, -error)


def test_pose_errors_up_to_the_flip_of_time() -> None:
    R = rotation(np.radians([0, 0, 10.0]))
    for found in (R, R.T):
        assert np.allclose(metrics.rotation_error(found, R), (0, 0), atol=1e-9)
    assert np.allclose(metrics.rotation_error(rotation(np.radians([0, 0, 15.0])), R), (5, 0.5))
    x, y = np.eye(3)[:2]
    for t, error in ((-3 * x, 0), (x + y, 45), (np.zeros(3), 90)):
        assert np.isclose(metrics.translation_direction_error_deg(t, x), error)
    scene = make_scene(np.random.default_rng(0), count=200)
    for F in (scene.F, -scene.F, 3 * scene.F.T):
        assert metrics.pose_error_deg(F, scene.K, scene.R, scene.t, scene.ends) < 1e-4
    turned = rotation(np.radians([0, 0, 2.0])) @ scene.R
    assert metrics.pose_error_deg(scene.F, scene.K, turned, scene.t, scene.ends) == pytest.approx(2, abs=1e-3)


def test_average_precision_of_known_cases() -> None:
    moving = np.array([True, True, False, False])
    for score, expected in (([4.0, 3, 2, 1], 1), ([1.0, 2, 3, 4], 5 / 12), (np.zeros(4), 0.5)):  # last: ties
        assert metrics.average_precision(np.array(score), moving) == pytest.approx(expected)
    assert np.isnan(metrics.average_precision(np.zeros(4), ~moving & moving))
