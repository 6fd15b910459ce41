"""Packing: what the page unpacks is what was packed, to half a step, and small."""

import base64
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from blur2view.results.report_pack import packed, picture
from tests.support.report_scenes import unpacked


@pytest.mark.parametrize("kind", ["uint8", "int16", "uint16", "int32"])
@pytest.mark.parametrize("shape", [(1,), (7,), (3, 5), (2, 3, 4), (4, 0)])
def test_integers_come_back_exactly(kind: str, shape: tuple[int, ...]) -> None:
    limits = np.iinfo(kind)
    values = np.random.default_rng(1).integers(limits.min, limits.max, shape, endpoint=True)
    back = packed(values, kind)
    assert back["step"] == 1 and back["type"] == kind
    np.testing.assert_array_equal(unpacked(back), values)


def test_differences_wrap_around_the_range() -> None:
    values = np.array([[-32768, 32767, -32768, 0]])
    np.testing.assert_array_equal(unpacked(packed(values, "int16")), values)


def test_error_is_at_most_half_a_step() -> None:
    values = np.random.default_rng(2).normal(0, 30, (40, 50))
    back = packed(values, "int16", 1 / 64)
    assert back["step"] == 1 / 64
    assert abs(unpacked(back) - values).max() <= 0.5 / 64


def test_step_doubles_until_every_value_fits() -> None:
    values = np.array([-900.0, 0.3, 700.0])
    back = packed(values, "int16", 1 / 64)
    assert back["step"] == 1 / 32
    assert abs(unpacked(back) - values).max() <= 0.5 / 32


@pytest.mark.parametrize("values", [[np.nan], [np.inf], [1.0, -0.5]])
def test_what_cannot_be_packed_is_refused(values: list[float]) -> None:
    with pytest.raises(ValueError):
        packed(np.array(values), "uint16", 1 / 64)


def test_smooth_fields_shrink() -> None:
    y, x = np.mgrid[:180, :320]
    smooth = 20 + 5 * np.sin(x / 30) + 4 * np.cos(y / 20)
    assert len(packed(smooth, "int16", 1 / 64)["data"]) < 0.6 * 2 * smooth.size


def decoded(uri: str) -> Image.Image:
    assert uri.startswith("data:image/jpeg;base64,")
    return Image.open(BytesIO(base64.b64decode(uri.split(",")[1])))


def test_picture_keeps_size_and_colours() -> None:
    image = np.zeros((48, 64, 3), np.float32)
    image[:, 32:] = (1, 0.5, 0.25)
    back = np.asarray(decoded(picture(image)), float) / 255
    assert back.shape == image.shape
    assert abs(back - image).max() < 0.1 and abs(back[:, 40:] - image[:, 40:]).max() < 0.02


def test_large_picture_is_reduced() -> None:
    assert decoded(picture(np.zeros((100, 300, 3), np.float32), side_px=60)).size == (60, 20)
