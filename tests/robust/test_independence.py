"""Errors that neighbours share, and how far they reach."""

import numpy as np

from blur2view.robust.independence import autocorrelation, independence


def test_white_noise_is_independent_and_a_smooth_field_is_not() -> None:
    rng = np.random.default_rng(0)
    middle, every = rng.uniform(0, 400, (2000, 2)), np.ones(2000, bool)
    white = rng.normal(size=(2, 2000))
    smooth = np.stack([np.sin(middle[:, 0] / 60), np.cos(middle[:, 1] / 60)])
    assert independence(white, every, middle) > 0.7
    assert independence(smooth, every, middle) < 0.05
    assert independence(smooth + 3 * white, every, middle) > independence(smooth, every, middle)
    assert independence(np.zeros((1, 2000)), every, middle) == 1


def test_values_that_are_not_used_do_not_count() -> None:
    rng = np.random.default_rng(1)
    middle, values = rng.uniform(0, 400, (1000, 2)), rng.normal(size=(1, 1000))
    used = rng.random(1000) < 0.7
    wild = np.where(used, values, 100.0)
    assert independence(wild, used, middle) == independence(values, used, middle)


def test_autocorrelation_reaches_as_far_as_the_errors() -> None:
    rng = np.random.default_rng(2)
    middle = rng.uniform(0, 400, (2000, 2))
    near, half = autocorrelation(np.sqrt(2) * np.sin(middle[:, 0] / 20), middle)
    assert near > 0.7
    assert 10 < half < 50  # halved after a sixth of the period of 126 or so, as directions are averaged
    assert autocorrelation(rng.normal(size=2000), middle)[0] < 0.2
