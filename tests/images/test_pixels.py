"""Brightness: darker photographs become as bright as most, others stay as they are."""

import numpy as np
import pytest

from blur2view.images.pixels import MAX_GAIN, brightened, brightness_gain


def test_a_darker_photograph_becomes_the_same_and_lamps_do_not_count() -> None:
    image = np.random.default_rng(0).random((300, 400, 3), np.float32) * np.float32(0.8)
    bright = brightened(image, brightness_gain(image))
    for share in (1, 0.5, 1 / 16):
        darker = image * np.float32(share)
        np.testing.assert_allclose(brightened(darker, brightness_gain(darker)), bright, rtol=1e-5)
    dark = np.full((100, 100, 3), 0.09, np.float32)
    dark[:5, :5] = 1
    assert brightness_gain(dark) == pytest.approx(10) and brightness_gain(bright, 0) == 1
    assert brightness_gain(np.zeros((9, 9), np.float32)) == MAX_GAIN


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_the_factor_of_levels_is_that_of_their_shares_of_white(kind: type[np.integer]) -> None:
    white = np.iinfo(kind).max
    levels = np.random.default_rng(1).integers(0, white // 3, (1200, 901, 3)).astype(kind)
    assert brightness_gain(levels) == brightness_gain(levels.astype(np.float32) / np.float32(white)) > 2
