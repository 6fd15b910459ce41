"""Measures against values worked out by hand."""

import numpy as np
import pytest

from tests.support.scenes import rotation
from tools.metrics import (
    direction_error_deg,
    epe_s,
    rotation_error,
    sparsification_area,
    translation_direction_error_deg,
)


def test_epe_s_and_direction_are_blind_to_sign() -> None:
    d, truth = np.array([[3.0, 4], [-3, -4], [0, 5], [0, 0]]), np.array([[3.0, 4], [3, 4], [3, 4], [3, 4]])
    assert np.allclose(epe_s(d, truth), [0, 0, np.sqrt(10), 5])
    expected = [0, 0, np.degrees(np.arccos(0.8)), 0]
    assert np.allclose(direction_error_deg(d, truth), expected)
    assert np.allclose(direction_error_deg([1.0, 0], [0.0, -2]), 90)


def test_sparsification_by_hand_and_its_order() -> None:
    assert np.isclose(sparsification_area([1.0, 3], [2.0, 1], steps=2), 0.5)
    error = np.random.default_rng(0).exponential(size=1000)
    assert sparsification_area(error, error**2) == 0
    chance = sparsification_area(error, np.random.default_rng(1).random(1000))
    assert 0 < chance < sparsification_area(error, -error)
    with pytest.raises(ValueError, match="expected two arrays"):
        sparsification_area(np.zeros(0), np.zeros(0))


def test_pose_errors_up_to_the_flip_of_time() -> None:
    R = rotation(np.radians([0, 0, 10.0]))
    for found in (R, R.T):
        assert np.allclose(rotation_error(found, R), (0, 0), atol=1e-9)
    assert np.allclose(rotation_error(rotation(np.radians([0, 0, 15.0])), R), (5, 0.5))
    assert rotation_error(R, np.eye(3))[1] == np.inf
    assert rotation_error(np.eye(3), np.eye(3)) == (0, 0)
    x, y = np.eye(3)[:2]
    assert np.isclose(translation_direction_error_deg(x, -3 * x), 0)
    assert np.isclose(translation_direction_error_deg(x, x + y), 45)
    assert translation_direction_error_deg(np.zeros(3), np.ones(3)) == 90
    with pytest.raises(ValueError, match="zero translation"):
        translation_direction_error_deg(x, 0 * x)
