"""Smears read off likelihoods: the truth that they were fitted to comes back, with a fitting uncertainty."""

import numpy as np
import pytest
from numpy.typing import NDArray

from blur2view.smears.likelihood import (
    DIRECTIONS,
    LABEL_SPREAD,
    PER_OCTAVE,
    SHORTEST_PX,
    marginals,
    read_smears,
    with_unseen,
)

Floats = NDArray[np.float32]

BINS = 24


def label(length: float, angle_deg: float) -> Floats:
    """Return the likelihood (32, BINS) that one known smear is fitted with."""
    centre = angle_deg * DIRECTIONS / 180
    apart = (np.arange(DIRECTIONS) - centre + DIRECTIONS / 2) % DIRECTIONS - DIRECTIONS / 2
    across = np.arange(BINS) - np.clip(1 + PER_OCTAVE * np.log2(length / SHORTEST_PX), 0, BINS - 1)
    parts = [np.exp(-x * x / (2 * LABEL_SPREAD**2)) for x in (apart, across)]
    return np.asarray(np.outer(*(part / part.sum() for part in parts)), np.float32)


def read(likelihood: Floats) -> tuple[float, float, float, float]:
    """Return length, direction in degrees and both sigmas of one cell."""
    x, y, sigma_px, sigma_rad = read_smears(np.log(likelihood + 1e-12)[None, None])[0, 0].tolist()
    return float(np.hypot(x, y)), float(np.degrees(np.arctan2(y, x)) / 2 % 180), sigma_px, sigma_rad


def turn_deg(first: float, second: float) -> float:
    """Return the angle between two directions without sign, degrees."""
    return abs((first - second + 90) % 180 - 90)


@pytest.mark.parametrize("angle_deg", [0, 0.4, 2.8, 17, 45, 90.5, 133.3, 176.5, 179.7])
@pytest.mark.parametrize("length", [3, 4.3, 9, 15.1, 33, 60])
def test_known_smear_comes_back(length: float, angle_deg: float) -> None:
    found, direction, sigma_px, sigma_rad = read(label(length, angle_deg))
    assert found == pytest.approx(length, rel=0.02)
    assert turn_deg(direction, angle_deg) < 0.3
    assert sigma_px < 0.05 * length + 0.2 and sigma_rad < np.deg2rad(1)


def test_circular_shift_of_the_directions_turns_the_smear() -> None:
    likelihood = 0.8 * label(12, 20) + 0.2 * label(5, 70)
    length, direction, sigma_px, sigma_rad = read(likelihood)
    for shift in (1, 9, 31):
        turned = read(np.roll(likelihood, shift, 0))
        assert turn_deg(turned[1], direction + shift * 180 / DIRECTIONS) < 0.01
        np.testing.assert_allclose([turned[0], *turned[2:]], [length, sigma_px, sigma_rad], rtol=1e-3)


def test_of_two_peaks_the_higher_is_read_and_doubted() -> None:
    length, direction, sigma_px, sigma_rad = read(0.7 * label(20, 30) + 0.3 * label(8, 120))
    assert length == pytest.approx(20, rel=0.03) and turn_deg(direction, 30) < 0.5
    assert sigma_rad == pytest.approx(np.sqrt(0.3) * np.pi / 2, rel=0.05)
    assert sigma_px == pytest.approx(np.sqrt(0.3 * (20**2 + 8**2)), rel=0.05)  # they are at right angles


def test_an_unseen_smear_may_have_any_direction() -> None:
    cells = np.array([[[3.0, 4.0, 1.0, 0.1]]], np.float32)
    np.testing.assert_array_equal(with_unseen(cells, np.zeros((1, 1), np.float32)), cells)
    *_, sigma_px, sigma_rad = with_unseen(cells, np.ones((1, 1), np.float32))[0, 0]
    assert sigma_px > 5
    assert np.isclose(sigma_rad, np.std(np.linspace(-np.pi / 2, np.pi / 2, 10001)), rtol=1e-3)


@pytest.mark.parametrize("octaves", [-0.5, 0.25, 1.0, 1.4])
def test_marginals_are_those_of_a_picture_which_is_smaller_by_octaves(octaves: float) -> None:
    found = marginals(np.log(label(12, 40) + 1e-9)[None, None], 32, octaves)[0, 0]
    np.testing.assert_allclose([found[:DIRECTIONS].sum(), found[DIRECTIONS:].sum()], 1, rtol=1e-4)
    mean = float(found[DIRECTIONS:] @ np.arange(32))
    assert mean == pytest.approx(1 + PER_OCTAVE * (np.log2(12 / SHORTEST_PX) - octaves), abs=0.05)
