"""Training: networks of drawn scenes are files that compute the same; a stopped run ends as a whole one."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch

from blur2view import ModelError, SmearNetwork
from blur2view.networks.model_file import MOVERS, UNET, OnnxNetwork
from blur2view.smears.likelihood import BINS, DIRECTIONS, read_smears
from tests.support.colour_code import colour_code_network
from tests.tools.rendering.test_layer_scenes import noise_and_disc
from tools.rendering.layer_scenes import Sources
from tools.training import export, train
from tools.training.examples import Drawing, Which
from tools.training.export import Exported, differences, load_average, octave_of, sample_picture, smear_inputs
from tools.training.mover_networks import BlurNet, UNet, compressed, mover_loss
from tools.training.reader import Circular, Reader, ReaderOptions, target_of
from tools.training.train import first_weights

Trained = Callable[..., Path]


@pytest.fixture
def trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Trained:
    """Return how to train a network for two steps on small scenes: its folder."""
    sources = [noise_and_disc(np.random.default_rng(0))] * 2
    monkeypatch.setattr(train, "split_sources", lambda *folders: sources)
    monkeypatch.setattr(train, "Drawing", small)

    def run(which: Which, out: str = "run", **words: Any) -> Path:
        options = {"steps": 2, "batch": 1, "side": 128, "workers": 0, "held": 1, "every": 1}
        train.main(which, [tmp_path], out=tmp_path / out, **options | words)
        return tmp_path / out

    return run


def small(*, size: tuple[int, int] | None, sources: Sources, **words: Any) -> Drawing:
    """Return the drawing of pictures that take little time."""
    return Drawing(size=size or (320, 256), sources=sources, **words)


@pytest.mark.slow
def test_resumed_run_ends_with_the_weights_of_one_without_a_stop(
    trained: Trained, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = trained("smear", "whole")
    line = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert line["step"] == 2 and line == json.loads((whole / "log.jsonl").read_text().splitlines()[-1])
    assert len(line) == 8 and np.isfinite(list(line.values())).all()
    save = train.save

    def stopped(*words: Any) -> None:
        save(*words)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(train, "save", stopped)
        trained("smear", "parted")
    parted = trained("smear", "parted")
    first, resumed = (load_average(one / "last.pt") for one in (whole, parted))
    assert first["step"] == resumed["step"] == 2 and first["figures"] == resumed["figures"]
    for name, one in first["average"].items():
        assert torch.equal(one, resumed["average"][name])


@pytest.mark.slow
@pytest.mark.parametrize("which", ["unet", "blur"])
def test_a_mover_network_of_drawn_scenes_is_one_that_the_package_takes(
    trained: Trained, which: Which, tmp_path: Path
) -> None:
    run = trained(which)
    figures = load_average(run / "last.pt")["figures"]
    assert figures and all(0 <= value <= 1 for value in figures.values())
    export.main(which, [run / "last.pt"] * 2, tmp_path / "file.onnx")
    network, form = (UNet(), UNET) if which == "unet" else (BlurNet(), MOVERS)
    sources = noise_and_disc(np.random.default_rng(0))
    batch = Drawing(which=which, sources=sources, count=1, size=(128, 96))[5]
    network.load_state_dict(first_weights(run / "last.pt", network))
    with torch.no_grad():
        said = network.eval()(*(batch[name] for name in form.inputs))
    found = OnnxNetwork(form, tmp_path / "file.onnx").run(*(batch[name][0].numpy() for name in form.inputs))
    expected = said[0][0, 4] if isinstance(said, tuple) else said[0, 0]
    np.testing.assert_allclose(found[0], expected, atol=0.05)
    assert found[0].shape[-2:] == (24, 32)


@pytest.mark.slow
def test_the_smear_networks_file_computes_what_torch_does_and_a_training_starts_from_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.manual_seed(0)
    options = ReaderOptions(window=8, region=12)
    network = Reader(options).eval()
    weights = {name: value + 0.01 * torch.randn_like(value) for name, value in network.state_dict().items()}
    network.load_state_dict(weights)  # no two of them are equal
    state = {"average": weights, "widths": vars(options), "step": 40, "seed": 3, "batch": 16}
    torch.save(state | {"figures": {"loss": 1.5}}, tmp_path / "last.pt")
    exported, exact, grey = tmp_path / "smear.onnx", tmp_path / "exact.onnx", sample_picture()
    monkeypatch.setattr(export, "sample_picture", lambda: grey)  # rendered once
    with monkeypatch.context() as patch:
        patch.setattr(export, "with_integers", lambda model, scratch: model)
        export.main("smear", [tmp_path / "last.pt"], exact)
    export.main("smear", [tmp_path / "last.pt"], exported)
    octave = Exported(network, octave_of)
    network.store_matrices()
    for height, width in ((64, 64), (96, 224)):
        inputs = smear_inputs(network, grey[..., :height, :width].contiguous())
        assert all(np.abs(one).max() < 2e-3 for one in differences(exact, octave, inputs))
        rounded = differences(exported, octave, inputs)
        assert all(np.sqrt(np.square(one).mean()) < 0.1 for one in rounded)
    reader = SmearNetwork(exported, threads=1)
    assert reader.info["license"] == "Apache-2.0" and reader.model_id.startswith("smear-")
    facts = {"figures": {"loss": 1.5}, "seed": 3, "batch": 16, "steps": [40]}
    assert json.loads(reader.info["training"]) == facts
    field = reader.predict(np.random.default_rng(0).random((190, 210, 3), dtype=np.float32)).at_pixels()
    assert field.shape == (190, 210) and np.isfinite(field.displacement).all()
    stored = first_weights(exported, Reader(options))
    assert {name for name in stored if not name.endswith("matrix")} == set(weights)
    for name, value in weights.items():  # the large products' in 7 bits, all others exactly
        circular = isinstance(network.get_submodule(name.rpartition(".")[0]), Circular)
        rounding = value.abs().max() / 63 if circular and value.ndim == 2 else 0
        assert (stored[name] - value).abs().max() <= rounding
    onnx.save(colour_code_network(), tmp_path / "other.onnx")
    with pytest.raises(ModelError, match="holds no weights"):
        first_weights(tmp_path / "other.onnx", Reader(options))


@pytest.mark.parametrize("k", [0, 7, 31])
@pytest.mark.parametrize("j", [4, 9, 18])
def test_target_is_a_distribution_with_its_maximum_at_the_truth(k: int, j: int) -> None:
    length, angle = 2.0 * 2 ** ((j - 1) / 4), np.pi * k / DIRECTIONS
    d = torch.tensor([length * np.cos(angle), length * np.sin(angle)], dtype=torch.float32)
    target, weight = target_of(d.expand(2, 3, 16, 2), torch.ones(2, 3, 16), BINS)
    assert target.shape == (2, 3, DIRECTIONS, BINS) and (weight == 1).all()
    torch.testing.assert_close(target.sum((-1, -2)), torch.ones(2, 3))
    assert divmod(int(target[0, 0].argmax()), BINS) == (k, j)
    x, y = read_smears(np.log(target[0, 0].numpy() + 1e-12)[None, None])[0, 0, :2]  # a double angle
    assert np.hypot(x, y) == pytest.approx(length, rel=0.05)
    assert np.abs(np.angle(np.exp(1j * (np.arctan2(y, x) - 2 * angle)))) < 0.02
    backwards, _ = target_of(-d.expand(16, 2), torch.ones(16), BINS)
    torch.testing.assert_close(backwards, target[0, 0], atol=1e-4, rtol=1e-3)


def test_the_loss_of_the_u_net_falls_as_the_truth_is_said() -> None:
    rng = np.random.default_rng(0)
    batch = {
        "displacement": torch.from_numpy(rng.normal(0, 6, (2, 2, 8, 8))).float(),
        "moving": torch.from_numpy(rng.integers(0, 2, (2, 8, 8))).float(),
        "share": torch.ones(2, 8, 8),
        "camera": torch.tensor([0.0, 1.0]),
    }
    said = torch.zeros(2, 5, 8, 8)
    said[:, 2:4] = -3
    nothing = mover_loss((said, torch.zeros(2)), batch)
    said[:, :2] = compressed(batch["displacement"])
    said[:, 4] = 20 * batch["moving"] - 10
    assert mover_loss((said, torch.tensor([-9.0, 9.0])), batch) < nothing - 3
    opposite = {**batch, "displacement": -batch["displacement"]}
    torch.testing.assert_close(compressed(opposite["displacement"]), compressed(batch["displacement"]))
