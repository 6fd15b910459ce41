"""The smear network: what it computes, and what it refuses."""

from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import onnx
import pytest
from numpy.typing import NDArray

from blur2view.errors import ModelError
from blur2view.networks import smear_network
from blur2view.networks.octaves import UNSEEN_SIGMA_PX
from blur2view.networks.smear_network import SmearNetwork
from blur2view.smears.grid import to_double_angle
from tests.support.colour_code import colour_code, colour_code_network, noise
from tools.metrics import direction_error_deg


def turning_field(height: int, width: int) -> NDArray[np.float64]:
    """Return smears too short to be refined, which turn and grow smoothly over the image, (H, W, 2)."""
    y, x = np.mgrid[:height, :width] / 400
    length, phi = 8 + 3 * np.sin(y), 0.5 * x + 0.8 * y
    return np.stack([length * np.cos(phi), length * np.sin(phi)], -1)


def difference(first: NDArray[np.floating], second: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the distance of two fields in double angle, blind to signs."""
    apart: NDArray[np.floating] = np.hypot(
        *np.moveaxis(to_double_angle(first) - to_double_angle(second), -1, 0)
    )
    return apart


@pytest.mark.parametrize("size", [(65, 33), (128, 192), (130, 250), (17, 16), (300, 50)])
def test_field_has_the_size_of_the_image_and_its_smears(tiny_model: Path, size: tuple[int, int]) -> None:
    true = turning_field(*size)
    image = colour_code(true, 1.0)
    before = image.copy()
    field = SmearNetwork(tiny_model).predict(image).at_pixels()
    np.testing.assert_array_equal(image, before)
    assert field.shape == size
    assert np.median(difference(field.displacement, true)) < 1.0  # a bin's likelihood is 10 % wide
    np.testing.assert_allclose(np.median(field.sigma_px), 1.0, rtol=0.3)


def test_cells_are_centred_as_the_convention_says(tiny_model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    angle = np.radians(60 + np.arange(256) / 4)  # even steps, so interpolation is exact
    true = np.broadcast_to(8 * np.stack([np.cos(angle), np.sin(angle)], -1), (96, 256, 2))
    monkeypatch.setattr(smear_network, "octave_count", lambda side: 1)
    field = SmearNetwork(tiny_model).predict(colour_code(true, 1.0)).at_pixels()
    assert direction_error_deg(field.displacement, true)[48, 15::32].max() < 0.5


def test_picture_without_texture_has_no_smears(blurring_model: Path) -> None:
    image = np.full((70, 90, 3), 0.9, np.float32)
    image[::7, ::5] += 1 / 255  # noise of one grey level
    field = SmearNetwork(blurring_model).predict(image).at_pixels()
    np.testing.assert_array_equal(field.length_px, 0)
    np.testing.assert_array_equal(field.sigma_px, UNSEEN_SIGMA_PX)


def with_nan() -> onnx.ModelProto:
    """Return the tiny network whose likelihoods are no numbers."""
    model = colour_code_network()
    (scale,) = (one for one in model.graph.initializer if one.name == "scale")
    scale.CopyFrom(onnx.numpy_helper.from_array(np.array([np.nan], np.float32), "scale"))
    return model


def with_pooling(place: int, size: int) -> onnx.ModelProto:
    """Return the tiny network with other means of cells (0) or of their neighbours (1)."""
    model = colour_code_network()
    pool = [node for node in model.graph.node if node.op_type == "AveragePool"][place]
    for attribute in pool.attribute:
        if attribute.name in ("kernel_shape", "strides"):
            attribute.ints[:] = [size] * 2
    return model


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (with_pooling(1, 32), "cannot be run on 96x64 values"),  # of more cells than the picture has
        (with_pooling(0, 8), r"gives shapes \[\(4, 6, 32, 2"),
        (with_nan(), "not finite"),
    ],
    ids=["window", "cells", "nan"],
)
def test_network_that_breaks_its_promise_is_named_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], model: onnx.ModelProto, words: str
) -> None:
    onnx.save(model, tmp_path / "wrong.onnx")
    with pytest.raises(ModelError, match=words) as caught:
        SmearNetwork(tmp_path / "wrong.onnx").predict(noise(64, 96))
    assert "wrong.onnx" in str(caught.value) and "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def smeared_photograph(length: float, angle_deg: float) -> NDArray[np.float32]:
    """Return a photograph of scikit-image that moved evenly during its exposure, with a little noise."""
    from skimage import data

    linear = (data.coffee().astype(np.float32) / 255) ** 2.2
    d = length * np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    total, steps = np.zeros_like(linear), 4 * int(length)
    for t in (np.arange(steps) + 0.5) / steps - 0.5:
        matrix = np.array([[1, 0, t * d[0]], [0, 1, t * d[1]]])
        size = (linear.shape[1], linear.shape[0])
        total += cv2.warpAffine(linear, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    coded = (total / steps) ** (1 / 2.2)
    coded += np.random.default_rng(0).normal(0, 0.004, coded.shape)
    return np.asarray(np.round(np.clip(coded, 0, 1) * 255) / 255, np.float32)


@pytest.mark.parametrize(("length", "within_deg", "within"), [(12.0, 2.0, 0.05), (24.0, 0.6, 0.015)])
def test_shipped_network_reads_an_evenly_blurred_photograph(
    length: float, within_deg: float, within: float
) -> None:
    angle_deg = 32.0
    network = SmearNetwork()
    assert network.info["license"]
    field = network.predict(smeared_photograph(length, angle_deg)).at_pixels()
    certain = field.sigma_rad <= np.median(field.sigma_rad)
    true = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    assert np.median(direction_error_deg(field.displacement, true)[certain]) < within_deg
    assert np.median(field.length_px[certain]) == pytest.approx(length, rel=within)


def large_photograph(length: float, angle_deg: float) -> NDArray[np.uint8]:
    """Return a photograph of 2400x1600 pixels that moved evenly, of 8 bits."""
    scale = 1 if length < 40 else 4
    moved = smeared_photograph(length / scale, angle_deg)
    side = -(-1600 // (moved.shape[0] * scale))
    larger = cv2.resize(
        np.tile(moved, (side, side, 1)), None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC
    )
    return np.asarray(np.round(255 * larger[:1600, :2400].clip(0, 1)), np.uint8)


@pytest.mark.parametrize(("length", "octaves_read"), [(10.0, 4), (56.0, 3), (160.0, 3)])
def test_large_photograph_is_read_in_the_octaves_that_its_smears_need(
    monkeypatch: pytest.MonkeyPatch, length: float, octaves_read: int
) -> None:
    network = SmearNetwork()
    run = Mock(wraps=network._network.run)
    monkeypatch.setattr(network._network, "run", run)
    grid = network.predict(large_photograph(length, 32.0))
    assert run.call_count == octaves_read
    assert grid.stride == 64 and grid.cells.shape == (25, 38, 4) and grid.window_px == 192
    field = grid.smears()
    certain = field.sigma_rad <= np.median(field.sigma_rad)
    true = np.array([np.cos(np.radians(32.0)), np.sin(np.radians(32.0))])
    assert np.median(direction_error_deg(field.displacement, true)[certain]) < 1.5
    assert np.median(field.length_px[certain]) == pytest.approx(length, rel=0.05)


def test_threads_change_no_byte_of_a_large_photograph() -> None:
    image = large_photograph(20.0, 70.0)
    first, second = (SmearNetwork(threads=n).predict(image) for n in (1, 3))
    assert first.cells.tobytes() == second.cells.tobytes() and first.blur is not None
    np.testing.assert_array_equal(first.blur, second.blur)
