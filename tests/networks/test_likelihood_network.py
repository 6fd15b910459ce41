"""A network that reads likelihoods: on whole photographs, tiles, octaves; and the shipped one."""

from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
from numpy.typing import NDArray

from blur2view.errors import ModelError
from blur2view.networks import octaves
from blur2view.networks.octaves import octave_count
from blur2view.networks.smear_network import SmearNetwork, predict
from blur2view.networks.tiles import TileOptions
from tests.support.grey_code import BINS, CODE_LENGTH_PX, grey_code, grey_code_network

TILED = TileOptions(max_pixels=1, tile_px=128, overlap_px=64)


@pytest.fixture(scope="module")
def grey_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of the tiny network."""
    path = tmp_path_factory.mktemp("model") / "grey.onnx"
    onnx.save(grey_code_network(), path)
    return path


def fan(height: int, width: int) -> NDArray[np.float64]:
    """Return directions (H, W), degrees, that turn from left to right and from top to bottom."""
    y, x = np.mgrid[:height, :width]
    return np.asarray(40 + 0.15 * x + 0.05 * y)


def error_deg(field: NDArray[np.floating], directions_deg: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the angle between smears (H, W, 2) and directions, degrees."""
    found = np.degrees(np.arctan2(field[..., 1], field[..., 0]))
    return np.asarray(np.abs((found - directions_deg + 90) % 180 - 90))


def test_cell_centres_are_where_the_convention_says(grey_model: Path) -> None:
    true = np.broadcast_to(60 + np.arange(256.0) / 4, (96, 256))  # even steps, so interpolation is exact
    field = SmearNetwork(grey_model).predict(grey_code(true), levels=1).at_pixels()
    centres = np.arange(15, 256, 32)
    assert error_deg(field.displacement, true)[48, centres].max() < 0.5


@pytest.mark.parametrize("size", [(1, 1), (17, 33), (5, 300), (63, 64)])
def test_tiny_pictures_are_read(grey_model: Path, size: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    field = predict(grey_code(rng.uniform(60, 120, size)), grey_model).at_pixels()
    assert field.shape == size and np.isfinite(field.displacement).all()
    if size != (1, 1):
        assert error_deg(field.displacement, np.full(size, 90.0)).max() < 15


@pytest.mark.parametrize("size", [(360, 400), (365, 411)])
def test_smaller_octaves_are_read_and_joined(grey_model: Path, size: tuple[int, int]) -> None:
    true, network = fan(*size), SmearNetwork(grey_model)
    field = network.predict(grey_code(true)).at_pixels()
    assert octave_count(size) == 3
    inner = slice(64, -64), slice(64, -64)
    assert np.median(error_deg(field.displacement, true)[inner]) < 4
    # each octave says 8 of its own pixels, so together they say more than the first
    assert np.median(field.length_px[inner]) > CODE_LENGTH_PX * 1.2


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (grey_code_network(cell=16), "cannot be run on 96x64 pixels|gives shape"),
        (grey_code_network(channels=3), r"gives shape \(1, 2, 3, 32, 3\)"),
        (grey_code_network(rows=16), rf"gives shape \(1, 2, 3, 16, ({BINS}|2)\)"),
        (grey_code_network(bins=40), r"gives shape \(1, 2, 3, 32, 40\)"),
        (grey_code_network(stride="64", multiple_of="64"), "reads windows 64 px apart instead of 32"),
    ],
    ids=["cells", "channels", "directions", "bins", "stride"],
)
def test_network_that_breaks_its_promise_is_named_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], model: onnx.ModelProto, words: str
) -> None:
    onnx.save(model, tmp_path / "wrong.onnx")
    with pytest.raises(ModelError, match=words) as caught:
        predict(grey_code(fan(64, 96)), tmp_path / "wrong.onnx")
    assert "wrong.onnx" in str(caught.value) and "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_network_without_a_fixed_number_of_features_is_refused(tmp_path: Path) -> None:
    model = grey_code_network()
    model.graph.input[3].type.tensor_type.shape.dim[4].dim_param = "C"
    onnx.save(model, tmp_path / "wrong.onnx")
    with pytest.raises(ModelError, match="does not fix the number of its features"):
        SmearNetwork(tmp_path / "wrong.onnx")


def test_octaves_may_be_smaller_than_a_window(grey_model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(octaves, "SMALLEST_PX", 16)
    for side in (64, 100, 128):
        for network in (SmearNetwork(grey_model), SmearNetwork(threads=1)):
            assert network.predict(grey_code(fan(side, side))).shape == (side, side)


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
    assert network.info.license
    field = network.predict(smeared_photograph(length, angle_deg)).at_pixels()
    assert field.sigma_rad is not None
    certain = field.sigma_rad <= np.median(field.sigma_rad)
    turn = error_deg(field.displacement, np.full(field.shape, angle_deg))[certain]
    assert np.median(turn) < within_deg
    assert np.median(field.length_px[certain]) == pytest.approx(length, rel=within)
