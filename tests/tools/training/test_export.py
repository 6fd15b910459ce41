"""The exported file: it computes what torch does, and says what a reader needs to know."""

import json
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
import skimage
import torch

from blur2view.camera.image import read_image
from blur2view.errors import ModelError
from blur2view.networks.smear_network import SmearNetwork
from tools.training import export_onnx
from tools.training.checkpoint import Run, load_average, start_run
from tools.training.export_onnx import Images, difference_px, export, sample_image
from tools.training.model import MULTIPLE_OF, ExportedSmear, ModelOptions, SmearUNet
from tools.training.stem import STRIDE

REAL = Path(__file__).resolve().parents[4] / "shared" / "data" / "real"
SHIPPED = Path(__file__).resolve().parents[3] / "models" / "smear.onnx"
NARROW = ModelOptions(widths=(16, 24, 32), bottom=1)


@pytest.fixture(scope="module")
def network() -> SmearUNet:
    """Give a network with random weights, whose normalisations have seen pictures.

    Its bias decides directions: where a vector vanishes, rounding alone turns it, in torch and ONNX alike.
    """
    torch.manual_seed(0)
    network = SmearUNet(NARROW).train()
    with torch.no_grad():
        for _ in range(5):
            network(torch.rand(2, 3, 64, 64))
        network.head.weight.mul_(0.2)
        network.head.bias += torch.tensor([1.0, 0.5, 0.0, 0.0, 0.0])  # type: ignore[operator]
    return network.eval()


@pytest.fixture(scope="module")
def checkpoint(network: SmearUNet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "last.pt"
    optimiser = torch.optim.AdamW(network.parameters())
    run = Run(network=network, average=network, optimiser=optimiser, step=40, figures={"epe_s": 1.23456})
    folders = {"train": Path("/somewhere"), "out": path.parent}
    run.save(path, {"seed": 5, "batch": 24, "processes": 2, **folders}, scenes=99)
    return path


@pytest.fixture(scope="module")
def exported(checkpoint: Path) -> Path:
    path = checkpoint.with_name("smear.onnx")
    export(checkpoint, path)
    return path


def test_onnx_equals_torch_in_every_size(exported: Path, network: SmearUNet) -> None:
    rng = np.random.default_rng(0)
    for shape in ((1, 64, 64), (2, 128, 64), (1, 96, 160)):
        images = rng.random((shape[0], 3, *shape[1:]), np.float32)
        assert difference_px(exported, network, images) < 1e-3
    assert difference_px(exported, network, sample_image()) < 1e-3


def test_onnx_equals_torch_on_a_real_photograph(exported: Path, network: SmearUNet) -> None:
    paths = sorted(REAL.glob("*.png")) + sorted(REAL.glob("*.jpg"))
    if not paths:
        pytest.skip(f"no photographs in {REAL}")
    bgr = cv2.imread(str(paths[0]))
    assert bgr is not None
    crop: Images = (bgr[:256, :320, ::-1] / 255).astype(np.float32)
    assert difference_px(exported, network, np.ascontiguousarray(crop.transpose(2, 0, 1)[None])) < 1e-3


def test_package_reads_the_exported_file(exported: Path, network: SmearUNet) -> None:
    loaded = SmearNetwork(exported)
    assert (loaded.info.stride, loaded.info.multiple_of) == (STRIDE, MULTIPLE_OF)
    assert loaded.info.license == "Apache-2.0" and loaded.info.model_id.startswith("smear-")
    assert loaded.info.training["steps"] == 40
    image = sample_image()
    with torch.no_grad():
        expected = ExportedSmear(network)(torch.from_numpy(image))[0].numpy()
    field = loaded.predict(np.ascontiguousarray(image[0].transpose(1, 2, 0)))
    assert field.shape == (256, 320)
    # the length at cells' centres, between four pixels, away from the border
    length = np.hypot(expected[0], expected[1])[4:-4, 4:-4]
    around = [field.length_px[dy::4, dx::4][4:-4, 4:-4] for dy in (1, 2) for dx in (1, 2)]
    assert np.median(np.abs(np.mean(around, 0) - length) / (length + 1)) < 0.05


def test_metadata_is_complete(exported: Path) -> None:
    stored = {entry.key: entry.value for entry in onnx.load(exported).metadata_props}
    assert stored["blur2view_format"] == "1"
    assert stored["stride"] == "4" and stored["multiple_of"] == str(MULTIPLE_OF)
    assert "0 to 1" in stored["convention"] and "cos 2phi" in stored["convention"]
    assert stored["license"] == "Apache-2.0" and len(stored["model_id"]) == len("smear-") + 12
    assert json.loads(stored["training"]) == {
        "seed": 5, "steps": 40, "crops": 1920, "scenes": 99, "figures": {"epe_s": 1.2346},
    }  # fmt: skip


def test_size_is_dynamic_and_names_are_those_of_the_contract(exported: Path) -> None:
    graph = onnx.load(exported).graph
    assert [value.name for value in graph.input] == ["image"]
    assert [value.name for value in graph.output] == ["smear"]
    for value in (*graph.input, *graph.output):
        batch, channels, *sides = value.type.tensor_type.shape.dim
        assert (
            channels.dim_value == (3 if value.name == "image" else 4)
            and batch.dim_param
            and all(side.dim_param for side in sides)
        )


def test_file_that_differs_from_torch_is_not_shipped(
    checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "smear.onnx"
    target.write_bytes(b"the one before")
    monkeypatch.setattr(export_onnx, "sample_image", lambda: np.zeros((1, 3, 64, 64), np.float32))
    for wrong in (0.01, float("nan")):
        monkeypatch.setattr(export_onnx, "difference_px", lambda *_, wrong=wrong: wrong)
        with pytest.raises(ModelError, match="differs from torch"):
            export(checkpoint, target)
        assert target.read_bytes() == b"the one before"


def test_weights_beside_the_file_start_another_training(exported: Path, network: SmearUNet) -> None:
    kept = exported.with_suffix(".pt")
    state = torch.load(kept, weights_only=True)
    assert set(state) == {"average", "model_options", "step", "steps_before", "figures", "scenes", "options"}
    assert state["options"] == {"seed": 5, "batch": 24, "processes": 2}
    run = start_run(3, 1e-3, torch.device("cpu"), weights=kept)
    assert (run.step, run.steps_before) == (0, 40)
    for mine, theirs, average in zip(
        run.network.parameters(), network.parameters(), run.average.parameters(), strict=True
    ):
        assert torch.equal(mine, theirs) and torch.equal(mine, average)


def test_shipped_network_is_its_shipped_weights_on_a_real_photograph() -> None:
    network, _ = load_average(SHIPPED.with_suffix(".pt"))
    photo: Images = read_image(Path(skimage.__file__).parent / "data" / "coffee.png")[:256, :320]
    assert difference_px(SHIPPED, network, np.ascontiguousarray(photo.transpose(2, 0, 1)[None])) < 1e-3
