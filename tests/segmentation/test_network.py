"""The motion segmentation network in the package: what it computes, on any size, and what it refuses."""

import warnings
from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper

from blur2view.errors import ModelError
from blur2view.networks.smear_network import SmearNetwork
from blur2view.segmentation.features import CHANNELS, LENGTH_UNIT, motion_features
from blur2view.segmentation.network import FORMAT, LONGEST_SIDES, MotionNetwork
from blur2view.segmentation.score import motion_score
from tests.support.colour_code import colour_code_network
from tests.support.motion_scenes import SIDEWAYS, STATIC_PX, estimate_of, sideways

Image = NDArray[np.float32]

REDNESS, LENGTH = 6.0, 2.0  # logit of a cell: REDNESS (R - 1/2) + LENGTH (what is told of its length)
LENGTH_CHANNEL = 4
METADATA = {
    "blur2view_format": FORMAT,
    "stride": "4",
    "multiple_of": "32",
    "model_id": "red-and-long",
    "license": "CC0-1.0",
}


def value_info(name: str, channels: int, axes: int = 4) -> onnx.ValueInfoProto:
    shape: list[str | int | None] = ["n", channels, "h", "w"]
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape[:axes])


def red_and_long(
    cell: int = 4, bias: float = -REDNESS / 2, outputs: int = 1, features: int = CHANNELS, **metadata: str
) -> onnx.ModelProto:
    """Return a network that calls red cells with long smears moving."""
    red, told = np.zeros((outputs, 3, 1, 1), np.float32), np.zeros((outputs, features, 1, 1), np.float32)
    red[:, 0], told[:, LENGTH_CHANNEL] = REDNESS, LENGTH
    nodes = [
        helper.make_node("AveragePool", ["image"], ["cells"], kernel_shape=[cell] * 2, strides=[cell] * 2),
        helper.make_node("Conv", ["cells", "red", "bias"], ["redness"]),
        helper.make_node("Conv", ["features", "told"], ["length"]),
        helper.make_node("Add", ["redness", "length"], ["moving"]),
    ]
    constants = {"red": red, "told": told, "bias": np.full(outputs, bias, np.float32)}
    graph = helper.make_graph(
        nodes,
        "red_and_long",
        [value_info("image", 3), value_info("features", features)],
        [value_info("moving", outputs)],
        [onnx.numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, METADATA | metadata)
    return model


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "red.onnx"
    onnx.save(red_and_long(), path)
    return path


@pytest.fixture(scope="module")
def network(path: Path) -> MotionNetwork:
    return MotionNetwork(path, threads=1)


def noise(shape: tuple[int, int], seed: int = 0) -> Image:
    return np.random.default_rng(seed).random((*shape, 3), dtype=np.float32)


def cells_of(network: MotionNetwork, image: Image) -> NDArray[np.float32]:
    height, width = image.shape[:2]
    smears = sideways((height, width)) * np.linspace(0.1, 2, width, dtype=np.float32)[:, None]
    found = estimate_of(smears, F=SIDEWAYS)
    return network.cells(found, image)


@pytest.mark.parametrize("size", [(64, 96), (65, 33), (17, 18), (31, 32), (5, 457), (1, 1), (2, 3)])
def test_every_cell_gets_the_probability_of_its_pixels_and_smears(
    network: MotionNetwork, size: tuple[int, int]
) -> None:
    image = noise(size)
    found = cells_of(network, image)
    rows, columns = (-(-side // 4) for side in size)
    padded = np.pad(
        image[..., 0], [(0, 4 * n - side) for n, side in zip((rows, columns), size, strict=True)], "reflect"
    )
    red = padded.reshape(rows, 4, columns, 4).mean(axis=(1, 3))
    at = np.minimum(4 * np.arange(columns) + 1, size[1] - 1)
    length = STATIC_PX * np.linspace(0.1, 2, size[1])[at]
    logit = REDNESS * (red - 0.5) + LENGTH * np.log1p(length) / LENGTH_UNIT
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, logit, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("size", [(480, 1280), (1000, 800), (3, 1500)])
def test_larger_photographs_are_made_smaller_with_their_smears(
    network: MotionNetwork, size: tuple[int, int]
) -> None:
    image = np.zeros((*size, 3), np.float32)
    image[:, size[1] // 2 :, 0] = 1
    found = estimate_of(sideways(size), F=SIDEWAYS)
    grid = network.cells(found, image)
    scale = LONGEST_SIDES[0] / max(size)
    assert grid.shape == tuple(-(-max(round(side * scale), 1) // 4) for side in size)
    length = LENGTH * np.log1p(scale * STATIC_PX) / LENGTH_UNIT
    left, right = grid[:, : grid.shape[1] // 2 - 1], grid[:, grid.shape[1] // 2 + 1 :]
    np.testing.assert_allclose(left, length - REDNESS / 2, rtol=1e-4)
    np.testing.assert_allclose(right, length + REDNESS / 2, rtol=1e-4)


def test_what_lies_beyond_the_photograph_is_no_cell_of_it(tmp_path: Path) -> None:
    """A network that looks far sees the mirrored picture and the last cells' features, not zeros."""
    model = red_and_long()
    kernel = np.zeros((1, CHANNELS, 3, 3), np.float32)
    kernel[0, 10, 1, 2] = 1.0  # whether the cell to the right has a homography
    model.graph.initializer[1].CopyFrom(onnx.numpy_helper.from_array(kernel, "told"))
    model.graph.node[2].attribute.append(helper.make_attribute("pads", [1, 1, 1, 1]))
    onnx.save(model, tmp_path / "far.onnx")
    found = estimate_of(sideways((20, 36)), H=np.array([[1, 0, STATIC_PX], [0, 1, 0], [0, 0, 1.0]]))
    image = np.full((20, 36, 3), 0.5, np.float32)
    grid = MotionNetwork(tmp_path / "far.onnx").cells(found, image)
    np.testing.assert_allclose(grid, 1, rtol=1e-5)


def test_probability_is_reproducible_and_changes_nothing(path: Path) -> None:
    image = noise((130, 170))
    before = image.copy()
    first, second = (cells_of(MotionNetwork(path), image) for _ in range(2))
    assert first.tobytes() == second.tobytes()
    np.testing.assert_array_equal(image, before)


def test_certainty_has_no_end_and_no_warning(tmp_path: Path) -> None:
    for bias, expected in ((-1e4, 0.0), (1e4, 1.0)):
        onnx.save(red_and_long(bias=bias), tmp_path / "sure.onnx")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            still = estimate_of(sideways((32, 32)), F=SIDEWAYS)
            found = MotionNetwork(tmp_path / "sure.onnx").probability(still, noise((32, 32)))
        np.testing.assert_allclose(found, expected, atol=1e-30)


def test_photograph_of_another_size_is_refused(network: MotionNetwork) -> None:
    found = estimate_of(sideways((32, 48)), F=SIDEWAYS)
    for shape in ((48, 32), (32, 52), (64, 96)):
        with pytest.raises(ValueError, match=r"expected an image of shape \(32, 48, 3\), got"):
            network.probability(found, noise(shape))


def test_network_tells_what_it_is(network: MotionNetwork) -> None:
    info = network.info
    assert (info.model_id, info.stride, info.multiple_of, info.license) == ("red-and-long", 4, 32, "CC0-1.0")


def with_another_input(axes: int) -> onnx.ModelProto:
    model = red_and_long()
    model.graph.input.append(value_info("more", 2, axes))
    return model


def without(key: str) -> onnx.ModelProto:
    model = red_and_long()
    kept = [entry for entry in model.metadata_props if entry.key != key]
    del model.metadata_props[:]
    model.metadata_props.extend(kept)
    return model


GOOD = red_and_long().SerializeToString()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot read the network"),
        (b"", "not an ONNX network.*export_motion"),
        (b"not a network", "not an ONNX network"),
        (GOOD[:200], "not an ONNX network"),
        (GOOD.replace(b"Pool", b"Poo\xff"), "not an ONNX network"),
        (GOOD.replace(b"CC0", b"CC\xff"), "damaged metadata"),
        (GOOD.replace(b"moving", b"movin\xff"), "damaged metadata"),
        (colour_code_network().SerializeToString(), "not a motion segmentation network"),
        (red_and_long(blur2view_format="motion-2").SerializeToString(), f"format {FORMAT}"),
        (without("blur2view_format").SerializeToString(), "not a motion segmentation network"),
        (red_and_long(features=CHANNELS - 1).SerializeToString(), "not a motion segmentation network"),
        (red_and_long(outputs=2).SerializeToString(), "not a motion segmentation network"),
        (GOOD.replace(b"moving", b"movers"), "not a motion segmentation network"),
        (with_another_input(4).SerializeToString(), "not a motion segmentation network"),
        (with_another_input(1).SerializeToString(), "not a motion segmentation network"),
        (without("model_id").SerializeToString(), "damaged metadata"),
        (red_and_long(stride="four").SerializeToString(), "damaged metadata"),
        (red_and_long(stride="8").SerializeToString(), "damaged metadata"),
        (red_and_long(multiple_of="0").SerializeToString(), "damaged metadata"),
        (red_and_long(multiple_of="30").SerializeToString(), "damaged metadata"),
    ],
)
def test_wrong_network_file_is_named_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], content: bytes | None, words: str
) -> None:
    wrong = tmp_path / "wrong.onnx"
    if content is not None:
        assert content != GOOD
        wrong.write_bytes(content)
    with pytest.raises(ModelError, match=words) as caught:
        MotionNetwork(wrong)
    assert str(wrong) in str(caught.value) and "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_it_is_no_network_of_smears(path: Path) -> None:
    with pytest.raises(ModelError, match="not a blur2view smear network"):
        SmearNetwork(path)


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (red_and_long(cell=2), "cannot be run on 32x64 pixels"),  # the two summands' sizes disagree
        (red_and_long(bias=np.nan), "other values than its format promises"),
        (red_and_long(bias=np.inf), "other values than its format promises"),
    ],
)
def test_network_that_breaks_its_promise_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], model: onnx.ModelProto, words: str
) -> None:
    onnx.save(model, tmp_path / "wrong.onnx")
    network = MotionNetwork(tmp_path / "wrong.onnx")
    with pytest.raises(ModelError, match=f"wrong.onnx: .*{words}") as caught:
        cells_of(network, noise((60, 30)))
    assert "\n" not in str(caught.value) and capfd.readouterr() == ("", "")


def test_grid_of_another_size_is_refused(tmp_path: Path) -> None:
    model = red_and_long(cell=2)
    del model.graph.node[2:]
    model.graph.node[1].output[0] = "moving"  # cells of two pixels, features unused
    onnx.save(model, tmp_path / "fine.onnx")
    with pytest.raises(ModelError, match="other values than its format promises"):
        cells_of(MotionNetwork(tmp_path / "fine.onnx"), noise((32, 32)))


def test_features_are_those_of_the_estimate(network: MotionNetwork, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[NDArray[np.float32]] = []

    def run(image: Image, features: Image) -> Image:
        seen.extend((image, features))
        return np.asarray(features[0, 0])

    monkeypatch.setattr(network, "_run", run)
    image, found = noise((36, 50)), estimate_of(sideways((36, 50)), F=SIDEWAYS)
    scored = motion_score(found)
    network.cells(found, image)
    assert seen[0].shape == (1, 3, 64, 64) and seen[1].shape == (1, CHANNELS, 16, 16)
    np.testing.assert_array_equal(seen[0][0, :, :36, :50], image.transpose(2, 0, 1))
    np.testing.assert_array_equal(seen[1][0, :, :9, :13], motion_features(found, scored))
    assert seen[0].flags.c_contiguous and seen[0].dtype == seen[1].dtype == np.float32


def test_cells_cover_the_photograph_and_may_reach_beyond(
    network: MotionNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ramp(_: Image, features: Image) -> Image:
        rows, columns = features.shape[2:]
        return np.linspace(0, 1, rows, dtype=np.float32)[:, None] + np.zeros((1, columns), np.float32)

    monkeypatch.setattr(network, "_run", ramp)
    found = estimate_of(sideways((18, 7)), F=SIDEWAYS)  # five cells of four pixels: two pixels are beyond
    grid, picture = network.cells(found, noise((18, 7))), network.probability(found, noise((18, 7)))
    assert grid.shape == (5, 2) and picture.shape == (18, 7) and picture.dtype == np.float32
    centres = 4 * np.arange(1, 4) + 1.5
    seen = np.interp(centres, np.arange(18), picture[:, 3])
    np.testing.assert_allclose(
        np.log(seen / (1 - seen)), grid[1:4, 0], atol=2e-3
    )  # OpenCV weighs in steps of 1 / 2048


@pytest.mark.parametrize("shape", [(720, 1280), (1, 1), (3, 1500)])
def test_every_pixel_gets_a_probability(network: MotionNetwork, shape: tuple[int, int]) -> None:
    found = estimate_of(sideways(shape), F=SIDEWAYS)
    picture = network.probability(found, np.full((*shape, 3), 0.5, np.float32))
    assert picture.shape == shape and np.ptp(picture) < 1e-3
