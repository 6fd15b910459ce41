"""The fast network: integers inside, the same answers to a few hundredths, and says whose child it is."""

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from blur2view.networks.smear_network import SmearNetwork
from tools.training.checkpoint import Run
from tools.training.export_onnx import export, sample_image
from tools.training.model import ModelOptions, SmearUNet
from tools.training.quantize import calibration_images, quantize


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Export a small network with random weights, and quantize it."""
    torch.manual_seed(0)
    network = SmearUNet(ModelOptions(widths=(16, 24, 32), bottom=1)).train()
    with torch.no_grad():
        for image in calibration_images(2):
            network(torch.from_numpy(image))
        network.head.bias += torch.tensor([2.0, 1.0, 0.0, 0.0, 0.0])  # type: ignore[operator]
    folder = tmp_path_factory.mktemp("models")
    run = Run(network=network, average=network, optimiser=torch.optim.AdamW(network.parameters()), step=1)
    run.save(folder / "last.pt", {"seed": 0, "batch": 1}, scenes=1)
    export(folder / "last.pt", folder / "exact.onnx")
    quantize(folder / "exact.onnx", folder / "fast.onnx", scenes=3)
    return folder / "exact.onnx", folder / "fast.onnx"


def test_fast_network_gives_nearly_the_same_smears(models: tuple[Path, Path]) -> None:
    image = np.ascontiguousarray(sample_image()[0].transpose(1, 2, 0))
    exact, fast = (SmearNetwork(path).predict(image) for path in models)
    difference = np.linalg.norm(fast.displacement - exact.displacement, axis=-1)
    assert 0 < np.median(difference) < 0.05 * np.median(exact.length_px)
    assert np.median(np.abs(np.log(fast.sigma_px / exact.sigma_px))) < 0.05


def test_only_the_stem_and_the_head_stay_in_floating_point(models: tuple[Path, Path]) -> None:
    graph = onnx.load(models[1]).graph
    made_by = {output: node.op_type for node in graph.node for output in node.output}
    integer = {
        n.name: made_by.get(n.input[0]) == "DequantizeLinear" for n in graph.node if n.op_type == "Conv"
    }
    assert sum(integer.values()) == 3 * 2 + 2 + 2 + 2 * 2  # encoders, bottom, lifts, decoders
    assert not any(whole for name, whole in integer.items() if "/stem" in name or "/head" in name)


def test_fast_network_names_its_source(models: tuple[Path, Path]) -> None:
    exact, fast = (SmearNetwork(path).info for path in models)
    assert fast.model_id.startswith(f"{exact.model_id}-int8-")
    assert (fast.license, fast.training, fast.stride) == (exact.license, exact.training, exact.stride)
    assert models[1].stat().st_size < 0.6 * models[0].stat().st_size
