"""Shaken pictures: what is still stays, an even motion is a box, and the truth says what was drawn."""

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tools.rendering.layers import DECODE, Path, averaged
from tools.rendering.shaken import ShakeOptions, shake

STILL = ShakeOptions(size=(96, 64), still_share=1.0, mover_share=0.0, rest_share=0.0, focus_share=0.0)


def photo(size: tuple[int, int] = (300, 400)) -> NDArray[np.uint8]:
    """Return smooth noise, (H, W, 3)."""
    noise = np.random.default_rng(0).normal(0, 1, (*size, 3)).astype(np.float32)
    smooth = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2))
    return np.asarray(np.clip(128 + 60 * smooth / smooth.std(), 0, 255), np.uint8)


def straight(shift: list[float], linear: Any = None) -> Path:
    """Return an even motion."""
    matrix = np.zeros((2, 2)) if linear is None else np.array(linear)
    return Path(shift=np.array(shift), linear=matrix, bend=np.zeros(2), acceleration=0.0)


def test_still_picture_is_a_piece_of_its_source() -> None:
    source = photo((64 + 16, 96 + 16))  # no larger than the picture and its margin: only mirrored
    for seed in range(5):
        made = shake(np.random.default_rng(seed), [source], STILL)
        assert not made.displacement.any() and not made.radius_px.any() and made.valid.all()
        mirrors = [DECODE[source][8:-8, 8:-8][::a, ::b] for a in (1, -1) for b in (1, -1)]
        assert min(np.abs(made.linear - mirror).max() for mirror in mirrors) < 1e-4


@pytest.mark.parametrize("length", [9, 15])
@pytest.mark.parametrize("axis", [0, 1])
def test_even_motion_is_a_box_along_it(length: int, axis: int) -> None:
    layer = DECODE[photo((64 + 64, 96 + 64))]
    shift = [float(length), 0.0] if axis == 0 else [0.0, float(length)]
    picture, (covered,) = averaged([layer], [straight(shift)], (96, 64), 40 * length)
    box = np.ones((1, length)) if axis == 0 else np.ones((length, 1))
    expected = cv2.filter2D(layer, -1, box / box.size)[32:-32, 32:-32]
    np.testing.assert_allclose(covered, 1, atol=1e-5)
    assert np.abs(picture - expected).max() < 0.01 * layer.max()
