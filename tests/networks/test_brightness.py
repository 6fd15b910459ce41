"""Brightness: darker photographs become as bright as most, others stay as they are."""

import numpy as np
import pytest

from blur2view.networks.brightness import LARGEST_GAIN, brightened, gain_of


@pytest.mark.parametrize("share", [1, 0.5, 1 / 16])
def test_a_darker_photograph_becomes_the_same(share: float) -> None:
    image = np.random.default_rng(0).random((300, 400, 3), np.float32) * np.float32(0.8)
    np.testing.assert_allclose(brightened(image * np.float32(share), 0.9), brightened(image, 0.9), rtol=1e-5)


def test_a_bright_one_is_not_touched_and_lamps_do_not_count() -> None:
    bright = np.full((100, 100, 3), 0.95, np.float32)
    assert brightened(bright, 0.9) is bright and brightened(bright, 0) is bright
    dark = np.full((100, 100, 3), 0.09, np.float32)
    dark[:5, :5] = 1
    assert gain_of(dark) == pytest.approx(10) and brightened(dark, 0.9).max() == 1
    assert gain_of(np.zeros((9, 9), np.float32)) == LARGEST_GAIN
