"""Brightness: darker photographs become as bright as most, others stay as they are."""

import numpy as np
import pytest

from blur2view.images.pixels import MAX_GAIN, brightened, gain_of


def test_a_darker_photograph_becomes_the_same_and_lamps_do_not_count() -> None:
    image = np.random.default_rng(0).random((300, 400, 3), np.float32) * np.float32(0.8)
    bright = brightened(image, gain_of(image))
    for share in (1, 0.5, 1 / 16):
        darker = image * np.float32(share)
        np.testing.assert_allclose(brightened(darker, gain_of(darker)), bright, rtol=1e-5)
    dark = np.full((100, 100, 3), 0.09, np.float32)
    dark[:5, :5] = 1
    assert gain_of(dark) == pytest.approx(10) and gain_of(bright, 0) == 1
    assert gain_of(np.zeros((9, 9), np.float32)) == MAX_GAIN


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_the_factor_of_levels_is_that_of_their_shares_of_white(kind: type[np.integer]) -> None:
    white = np.iinfo(kind).max
    levels = np.random.default_rng(1).integers(0, white // 3, (1200, 901, 3)).astype(kind)
    assert gain_of(levels) == gain_of(levels.astype(np.float32) / np.float32(white)) > 2
