"""The exported reader: it computes what torch does, says what it is, and replaces nothing if it does not."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from blur2view import ModelError, SmearNetwork
from tests.support.colour_code import colour_code_network
from tools.training import export
from tools.training.export import MOST_ROUNDED, differences
from tools.training.export_reader import ExportedOctave, inputs_of, main, sample_picture
from tools.training.reader import Circular, Reader, ReaderOptions
from tools.training.train_reader import exported_weights, load_average

pytestmark = pytest.mark.slow
SMALL = ReaderOptions(window=8, region=12)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write what a run of random weights would, no two of which are equal."""
    torch.manual_seed(0)
    weights = {
        name: value + 0.01 * torch.randn_like(value) for name, value in Reader(SMALL).state_dict().items()
    }
    path = tmp_path_factory.mktemp("run") / "last.pt"
    state = {"network": weights, "average": weights, "widths": asdict(SMALL), "step": 40}
    torch.save(state | {"figures": {"held": {"loss": 1.5}}, "options": {"seed": 3, "batch": 16}}, path)
    return path


def test_file_computes_what_torch_does_and_the_package_and_a_training_read_it(
    checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exported, (trained, _) = tmp_path / "smear.onnx", load_average(checkpoint)
    exact = tmp_path / "exact.onnx"
    with monkeypatch.context() as patch:
        patch.setattr(export, "with_integers", lambda model, scratch: model)
        main(checkpoint, exact)
    main(checkpoint, exported)
    grey = sample_picture()
    assert grey.min() >= 0 and grey.max() <= 1
    for height, width in ((256, 320), (64, 64), (96, 224)):
        inputs = inputs_of(trained, grey[..., :height, :width].contiguous())
        for one in differences(exact, ExportedOctave(trained), inputs):
            assert np.abs(one).max() < 2e-3
        for one in differences(exported, ExportedOctave(trained), inputs):
            assert np.sqrt(np.square(one).mean()) < MOST_ROUNDED / 2
    network = SmearNetwork(exported, threads=1)
    info = network.info
    assert (info.features, info.license) == (12, "Apache-2.0")
    assert info.model_id.startswith("smear-") and info.training["pictures"] == 640
    assert info.training["figures"] == {"held": {"loss": 1.5}} and info.training["seed"] == 3
    image = np.random.default_rng(0).random((190, 210, 3), dtype=np.float32)
    field = network.predict(image).at_pixels()
    assert field.shape == (190, 210) and np.isfinite(field.displacement).all()
    trained = load_average(checkpoint)[0]
    stored = exported_weights(exported, Reader(SMALL))
    assert stored.keys() == trained.state_dict().keys()
    for name, value in trained.state_dict().items():  # the large products' in 7 bits, all others exactly
        circular = isinstance(trained.get_submodule(name.rpartition(".")[0]), Circular)
        rounding = value.abs().max() / 63 if circular and value.ndim == 2 else 0
        assert (stored[name] - value).abs().max() <= rounding
    onnx.save(colour_code_network(), tmp_path / "other.onnx")
    with pytest.raises(ModelError, match="holds no weights"):
        exported_weights(tmp_path / "other.onnx", Reader(SMALL))
