"""Pixels: Pillow's pictures as arrays; darker photographs become as bright as most."""

import numpy as np
import pytest
from PIL import Image

from blur2view.arrays import AnyArray, ranked
from blur2view.images import pixels
from blur2view.images.pixels import MAX_GAIN, as_photograph, brightened, brightness_gain


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


@pytest.mark.parametrize("mode", ["1", "L", "P", "RGB", "RGBA", "CMYK", "F"])
def test_picture_of_pillow_is_the_same_in_strips_as_in_one_piece(
    mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = np.random.default_rng(0).integers(0, 256, (13, 7, 3), np.uint8)
    floats = Image.fromarray(values[..., 0] / np.float32(255))
    picture = floats if mode == "F" else Image.fromarray(values).convert(mode)
    whole = as_photograph(picture)
    monkeypatch.setattr(pixels, "STRIP_PIXELS", 14)  # two rows, and one at the end
    np.testing.assert_array_equal(as_photograph(picture), whole)


def test_grey_in_three_equal_channels_of_one_memory_is_read_as_grey() -> None:
    grey = np.arange(6, dtype=np.uint8).reshape(2, 3)
    np.testing.assert_array_equal(as_photograph(np.broadcast_to(grey[..., None], (2, 3, 3))), grey)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_values_of_ranks_are_those_of_the_sorted_array(dtype: type) -> None:
    levels: AnyArray = np.random.default_rng(0).integers(0, 200, (31, 17, 3)).astype(dtype)
    values = levels[::2, ::2]
    ranks = [0, 1, 200, values.size - 1]
    assert (ranked(values, ranks) == np.sort(values, axis=None)[ranks]).all()
