"""Shaken pictures: what is still stays, an even motion is a box, and the truth says what was drawn."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tools.rendering import shaken
from tools.rendering.shaken import DECODE, Path, ShakeOptions, averaged, cell_centres, shake

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


def test_smear_at_the_centre_has_the_length_that_was_drawn() -> None:
    centres = cell_centres((96, 64))
    np.testing.assert_array_equal(centres[0, 0], [1.5 - 47.5, 1.5 - 31.5])
    np.testing.assert_allclose(centres.mean((0, 1)), 0, atol=1e-12)
    moving = replace(STILL, smear_px=(20.0, 20.001), short_share=0.0, still_share=0.0)
    for seed in range(5):
        made = shake(np.random.default_rng(seed), [photo()], moving)
        centre = made.displacement[7:9, 11:13].mean((0, 1))  # the four cells about the middle
        assert np.hypot(*centre) == pytest.approx(20, rel=1e-3)


def test_two_layers_are_labelled_by_what_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [straight([0.0, 0.0]), straight([0.0, 12.0])]
    outline = np.zeros((64, 96), np.float32)
    outline[:, 48:] = 1
    monkeypatch.setattr(shaken, "sample_paths", lambda *_: paths)
    monkeypatch.setattr(shaken, "blob", lambda *_: outline)
    sources = [np.full((300, 400, 3), 255, np.uint8)]
    made = shake(np.random.default_rng(0), sources, STILL)
    linear, displacement, valid = made.linear, made.displacement, made.valid
    np.testing.assert_array_equal(displacement[8, :12], np.zeros((12, 2)))
    np.testing.assert_array_equal(displacement[8, 12:], np.tile([0.0, 12.0], (12, 1)))
    assert valid[8].all() and not valid[0, 12:].any()  # above, the second layer comes and goes
    np.testing.assert_allclose(linear, 1, atol=1e-5)  # white before white


def test_before_a_camera_at_rest_only_what_is_cut_out_moves() -> None:
    options = replace(STILL, rest_share=1.0, smear_px=(10.0, 20.0))
    for seed in range(6):
        made = shake(np.random.default_rng(seed), [photo()], options)
        length = np.hypot(*np.moveaxis(made.displacement, -1, 0))
        assert (length == 0).mean() > 0.2 and length.max() > 5
