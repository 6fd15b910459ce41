"""The exported reader: it computes what torch does, says what it is, and a training can start from it."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from blur2view import ModelError, SmearNetwork
from tests.support.colour_code import colour_code_network
from tools.training import export
from tools.training.export import ExportedOctave, differences, inputs_of, main, sample_picture
from tools.training.reader import Circular, Reader, ReaderOptions
from tools.training.train_reader import exported_weights

pytestmark = pytest.mark.slow
SMALL = ReaderOptions(window=8, region=12)


def test_file_computes_what_torch_does_and_the_package_and_a_training_read_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.manual_seed(0)
    trained = Reader(SMALL).eval()
    weights = {name: value + 0.01 * torch.randn_like(value) for name, value in trained.state_dict().items()}
    trained.load_state_dict(weights)  # no two of them are equal
    state = {"average": weights, "widths": asdict(SMALL), "step": 40, "seed": 3, "batch": 16}
    torch.save(state | {"figures": {"0": {"loss": 1.5}}}, tmp_path / "last.pt")
    exported, exact = tmp_path / "smear.onnx", tmp_path / "exact.onnx"
    with monkeypatch.context() as patch:
        patch.setattr(export, "with_integers", lambda model, scratch: model)
        main("reader", [tmp_path / "last.pt"], exact)
    main("reader", [tmp_path / "last.pt"], exported)
    grey = sample_picture()
    for height, width in ((64, 64), (96, 224)):
        inputs = inputs_of(trained, grey[..., :height, :width].contiguous())
        assert all(np.abs(one).max() < 2e-3 for one in differences(exact, ExportedOctave(trained), inputs))
        rounded = differences(exported, ExportedOctave(trained), inputs)
        assert all(np.sqrt(np.square(one).mean()) < 0.1 for one in rounded)
    network = SmearNetwork(exported, threads=1)
    info = network.info
    assert info["license"] == "Apache-2.0"
    assert network.model_id.startswith("smear-")
    training = {"figures": {"0": {"loss": 1.5}}, "seed": 3, "batch": 16, "steps": [40]}
    assert json.loads(info["training"]) == training
    field = network.predict(np.random.default_rng(0).random((190, 210, 3), dtype=np.float32)).at_pixels()
    assert field.shape == (190, 210) and np.isfinite(field.displacement).all()
    stored = exported_weights(exported, Reader(SMALL))
    plain = {name for name in stored if not name.endswith("matrix")}
    assert plain == set(weights)
    for name, value in weights.items():  # the large products' in 7 bits, all others exactly
        circular = isinstance(trained.get_submodule(name.rpartition(".")[0]), Circular)
        rounding = value.abs().max() / 63 if circular and value.ndim == 2 else 0
        assert (stored[name] - value).abs().max() <= rounding
    onnx.save(colour_code_network(), tmp_path / "other.onnx")
    with pytest.raises(ModelError, match="holds no weights"):
        exported_weights(tmp_path / "other.onnx", Reader(SMALL))
