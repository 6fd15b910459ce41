"""Errors that neighbours share, and how far they reach."""

import numpy as np

from blur2view.robust.independence import block_scatter, independence, slow_errors
from blur2view.robust.problem import build_problem


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


def test_scatter_of_blocks_is_that_of_sums_that_err_alike() -> None:
    rng = np.random.default_rng(2)
    middle = rng.uniform(0, 400, (2000, 2))
    white = rng.normal(size=(2, 2000))
    ratio = np.diag(block_scatter(white, middle)) / 2000
    assert (ratio > 0.4).all() and (ratio < 2).all()
    alike = np.sign(np.sin(middle.T / 60))
    assert (np.diag(block_scatter(alike, middle)) > 20 * 2000).all()


def test_slow_errors_are_of_the_stated_size() -> None:
    rng = np.random.default_rng(3)
    middle, d = rng.uniform(0, 400, (500, 2)), np.tile([3.0, 4.0], (500, 1))
    ends = np.stack([middle - d / 2, middle + d / 2], axis=1)
    problem = build_problem(ends, np.full(500, 0.25), (400, 400)).rescaled(0.1)
    errors = slow_errors(problem) * problem.unit_px
    assert errors.shape == (6, 500, 2)
    np.testing.assert_allclose(np.linalg.norm(errors[:2], axis=2), 2**0.5 * 0.25)  # alike everywhere
    np.testing.assert_allclose(np.abs(errors[0] @ [0.6, 0.8]), 2**0.5 * 0.25)  # of lengths
    np.testing.assert_allclose(errors[1] @ [0.6, 0.8], 0, atol=1e-12)  # of directions
    for error, axis in zip(errors[2:], (0, 0, 1, 1), strict=True):
        size = np.linalg.norm(error, axis=1)
        assert np.corrcoef(size, np.abs(middle[:, axis] - np.median(middle[:, axis])))[0, 1] > 0.99
