"""The exported motion segmentation network: it computes what torch does, and says what it is."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from blur2view.errors import ModelError
from blur2view.segmentation.features import CHANNELS, motion_features
from blur2view.segmentation.network import FORMAT, MotionNetwork
from blur2view.segmentation.score import motion_score
from tests.support.motion_scenes import SIDEWAYS, estimate_of, sideways
from tests.tools.training.test_motion_training import NARROW, QUICK, bad_checkpoint
from tests.tools.training.test_motion_training import small_and_alone as small_and_alone
from tools.training import export_motion
from tools.training.motion_model import MotionUNet
from tools.training.train_motion import MotionRun, load_network


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a run of random weights whose normalisations have seen pictures."""
    torch.manual_seed(0)
    network = MotionUNet(NARROW).train()
    with torch.no_grad():
        for _ in range(3):
            network(torch.rand(2, 3, 64, 64), torch.randn(2, CHANNELS, 16, 16))
    average = MotionUNet(NARROW)
    average.load_state_dict(network.state_dict())
    run = MotionRun(
        network=network, average=average, optimiser=torch.optim.AdamW(network.parameters()), step=40
    )
    path = tmp_path_factory.mktemp("run") / "motion.pt"
    run.save(path, replace(QUICK, seed=9), 77)
    return path


@pytest.fixture
def exported(checkpoint: Path) -> Path:
    target = checkpoint.with_name("motion.onnx")
    if not target.exists():
        export_motion.export(checkpoint, target)
    return target


def test_package_computes_what_torch_does_in_every_size(exported: Path, checkpoint: Path) -> None:
    (network, _), loaded = load_network(checkpoint), MotionNetwork(exported, threads=1)
    for size in ((64, 96), (32, 32), (96, 64), (50, 70)):
        image = np.random.default_rng(1).random((*size, 3), dtype=np.float32)
        found = estimate_of(sideways(size), F=SIDEWAYS)
        scored = motion_score(found)
        grid = loaded.cells(found, image)
        assert grid.shape == tuple(-(-side // 4) for side in size)
        if any(side % 32 for side in size):
            continue
        features = torch.from_numpy(motion_features(found, scored)[None])
        with torch.no_grad():
            logits = network(torch.from_numpy(image.transpose(2, 0, 1)[None].copy()), features)
        np.testing.assert_allclose(grid, logits[0, 0], atol=1e-3)


def test_directions_on_the_axes_survive_the_export(exported: Path, checkpoint: Path) -> None:
    """At these the exported arc tangent divides by zero or jumps."""
    (network, _), loaded = load_network(checkpoint), MotionNetwork(exported, threads=1)
    image = np.random.default_rng(2).random((1, 3, 32, 64), dtype=np.float32)
    features = np.random.default_rng(3).normal(0, 0.5, (1, CHANNELS, 8, 16)).astype(np.float32)
    axes = [
        (1, 0),
        (-1, 0),
        (0, 1),
        (0, -1),
        (-1, -0.0),
        (-0.0, 1),
        (-0.0, -1),
        (0, 0),
        (-0.0, -0.0),
        (1e-5, 0),
    ]
    for k, direction in enumerate(axes):
        features[0, :2, :, k] = np.array(direction, np.float32)[:, None]
    with torch.no_grad():
        expected = network(torch.from_numpy(image), torch.from_numpy(features))[0, 0]
    np.testing.assert_allclose(loaded._run(image, features), expected, atol=1e-3)


def test_metadata_tells_format_licence_and_training(exported: Path) -> None:
    stored = {entry.key: entry.value for entry in onnx.load(exported).metadata_props}
    assert stored["blur2view_format"] == FORMAT and stored["license"] == "Apache-2.0"
    assert stored["training"] == '{"seed": 9, "batch": 3, "examples": 77, "steps": 40}'
    assert f"(N,{CHANNELS},H/stride,W/stride)" in stored["convention"]
    info = MotionNetwork(exported).info
    assert (info.stride, info.multiple_of, info.license) == (4, 32, "Apache-2.0")
    assert info.model_id == stored["model_id"] and len(info.model_id) == len("motion-") + 12


def test_sizes_are_dynamic(exported: Path) -> None:
    graph = onnx.load(exported).graph
    assert [value.name for value in (*graph.input, *graph.output)] == ["image", "features", "moving"]
    for value, count in zip((*graph.input, *graph.output), (3, CHANNELS, 1), strict=True):
        batch, channels, *sides = value.type.tensor_type.shape.dim
        assert channels.dim_value == count and batch.dim_param and all(side.dim_param for side in sides)


def test_file_that_differs_from_torch_is_not_shipped(
    checkpoint: Path, exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export_motion, "write_graph", lambda _, path: shutil.copy(exported, path))
    target = tmp_path / "motion.onnx"
    target.write_bytes(b"the one before")
    for wrong in (0.01, float("nan")):
        monkeypatch.setattr(export_motion, "difference", lambda *_, wrong=wrong: wrong)
        with pytest.raises(ModelError, match="differs from torch"):
            export_motion.export(checkpoint, target)
        assert target.read_bytes() == b"the one before"


def test_difference_is_that_of_other_weights(exported: Path, checkpoint: Path) -> None:
    network, _ = load_network(checkpoint)
    assert export_motion.difference(exported, network) < 1e-4
    with torch.no_grad():
        assert network.head.bias is not None
        network.head.bias += 0.25
    assert export_motion.difference(exported, network) == pytest.approx(0.25, abs=1e-3)


def test_export_command_writes_into_a_new_folder(
    checkpoint: Path,
    exported: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(export_motion, "write_graph", lambda _, path: shutil.copy(exported, path))
    target = tmp_path / "new" / "motion.onnx"
    monkeypatch.setattr("sys.argv", ["export_motion", str(checkpoint), str(target)])
    export_motion.main()
    assert MotionNetwork(target).info.model_id and "step 40" in capsys.readouterr().out
    assert [path.name for path in target.parent.iterdir()] == ["motion.onnx"]


@pytest.mark.parametrize("kind", ["missing", "damaged", "folder", "other", "list"])
def test_export_command_names_what_is_no_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    path = bad_checkpoint(tmp_path / "run.pt", kind)
    monkeypatch.setattr("sys.argv", ["export_motion", str(path), str(tmp_path / "motion.onnx")])
    with pytest.raises(SystemExit, match="is no checkpoint of python -m tools.training.train_motion"):
        export_motion.main()
