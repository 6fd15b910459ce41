"""Training: it learns, it resumes exactly, its checkpoints load."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tools.datasets.shards import Scenes, load_shards, training_record
from tools.rendering.render import RenderOptions
from tools.training import checkpoint, model, train, validation
from tools.training.checkpoint import Run, follow, load_average, start_run
from tools.training.crops import CropStream
from tools.training.loss import Loss
from tools.training.train import TrainOptions, advance, learning_rate_at

NARROW = model.ModelOptions(widths=(16, 24, 32), bottom=1)


@pytest.fixture(autouse=True)
def small_and_alone(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Train a narrow network, validate on few small crops, on one thread: the same sums in the same order."""

    def narrow(options: model.ModelOptions = NARROW) -> model.SmearUNet:
        return model.SmearUNet(options)

    monkeypatch.setattr(checkpoint, "SmearUNet", narrow)
    monkeypatch.setattr(validation, "CROPS", 4)
    monkeypatch.setattr(validation, "SIDE", 64)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def shards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Render four small scenes."""
    folder, options = tmp_path_factory.mktemp("shards"), RenderOptions(size=(128, 96), smear_px=(4.0, 16.0))
    for seed in range(4):
        training_record(seed, options).save(folder / f"train_{seed:08d}.npz")
    return folder


def options_of(shards: Path, out: Path, **changes: int) -> TrainOptions:
    options = TrainOptions(train=shards, val=shards, out=out, steps=4, batch=3, side=64, workers=0)
    return replace(options, **changes)  # type: ignore[arg-type]


def weights(run: Run) -> list[np.ndarray]:
    networks = (run.network, run.average)
    return [tensor.numpy() for network in networks for tensor in network.state_dict().values()]


def test_a_few_steps_lower_the_loss(shards: Path, tmp_path: Path) -> None:
    options = options_of(shards, tmp_path, batch=8)
    images, targets = CropStream(load_shards(shards), seed=0, batch=8, side=64).make(0)
    run = start_run(0, options.learning_rate, torch.device("cpu"))
    run.step, schedule = 300, replace(options, steps=100_000)  # past the warm-up
    losses = [advance(run, images, targets, schedule).total.item() for _ in range(40)]
    assert np.mean(losses[-5:]) < 0.7 * np.mean(losses[:3])
    assert not run.network.stem.binomial.requires_grad


def test_resumed_run_equals_an_uninterrupted_one(
    shards: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = {"steps": 6, "save_every": 2, "validate_every": 3}
    whole = train.train(options_of(shards, tmp_path / "whole", **plan))
    parts, calls = options_of(shards, tmp_path / "parts", **plan), 0

    def killed_in_step_six(*arguments: object) -> Loss:
        nonlocal calls
        calls += 1
        if calls == 6:
            raise KeyboardInterrupt
        return advance(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(train, "advance", killed_in_step_six)
    with pytest.raises(KeyboardInterrupt):
        train.train(parts)
    resumed = train.train(parts)
    assert calls == 8 and resumed.step == whole.step == 6  # steps 5 and 6 came after the checkpoint of step 4
    for expected, found in zip(weights(whole), weights(resumed), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert resumed.figures == whole.figures
    stored = torch.load(tmp_path / "parts" / "last.pt", weights_only=True)
    assert stored["step"] == 6 and stored["scenes"] == 4 and stored["options"]["batch"] == 3
    steps = [json.loads(line)["step"] for line in (tmp_path / "parts" / "log.jsonl").read_text().splitlines()]
    assert steps == [3, 6]


def test_checkpoint_restores_the_last_figures_and_step(tmp_path: Path) -> None:
    run = start_run(1, 1e-3, torch.device("cpu"))
    run.step, run.figures = 7, {"epe_s": 1.5}
    run.save(tmp_path / "last.pt", {}, scenes=12)
    resumed = start_run(2, 1e-3, torch.device("cpu"), tmp_path / "last.pt")
    assert resumed.step == 7 and resumed.figures == {"epe_s": 1.5}
    for a, b in zip(weights(run), weights(resumed), strict=True):
        np.testing.assert_array_equal(a, b)


def test_checkpoint_gives_its_averaged_network(tmp_path: Path) -> None:
    run = start_run(1, 1e-3, torch.device("cpu"))
    with torch.no_grad():
        run.average.head.weight.add_(1)
    run.step, run.figures = 7, {"epe_s": 1.5}
    run.save(tmp_path / "last.pt", {"seed": 1, "out": Path("there")}, scenes=12)
    network, state = load_average(tmp_path / "last.pt")
    assert not network.training and network.options == NARROW
    assert torch.equal(network.head.weight, run.average.head.weight)
    assert not torch.equal(network.head.weight, run.network.head.weight)
    assert state["step"] == 7 and state["scenes"] == 12 and state["options"] == {"seed": 1, "out": "there"}
    assert set(state) == {
        "network", "average", "optimiser", "step", "steps_before",
        "model_options", "options", "figures", "scenes",
    }  # fmt: skip
    assert [path.name for path in tmp_path.iterdir()] == ["last.pt"]


def test_weights_follow_from_the_seed() -> None:
    first, again, other = (start_run(seed, 1e-3, torch.device("cpu")) for seed in (3, 3, 4))
    for a, b in zip(weights(first), weights(again), strict=True):
        np.testing.assert_array_equal(a, b)
    assert not torch.equal(first.network.head.weight, other.network.head.weight)


def test_average_follows_slowly_and_starts_fast() -> None:
    run = start_run(0, 1e-3, torch.device("cpu"))
    with torch.no_grad():
        run.average.head.weight.fill_(0)
        run.network.head.weight.fill_(1)
    run.network.encoders[0].norms[0].num_batches_tracked.fill_(9)  # type: ignore[union-attr, index]
    follow(run.average, run.network, step=1)
    np.testing.assert_allclose(run.average.head.weight.detach(), 1 - 2 / 11, rtol=1e-6)
    follow(run.average, run.network, step=10**6)
    np.testing.assert_allclose(run.average.head.weight.detach(), 1 - 0.998 * 2 / 11, rtol=1e-6)
    assert run.average.state_dict()["encoders.0.norms.0.num_batches_tracked"] == 9


def test_learning_rate_warms_up_and_falls_to_a_hundredth(tmp_path: Path) -> None:
    options = options_of(tmp_path, tmp_path, steps=10_000)
    rate = [learning_rate_at(step, options) for step in range(10_001)]
    assert rate[0] == pytest.approx(options.learning_rate / 300)
    assert max(rate) == pytest.approx(options.learning_rate, rel=0.01) and 250 < int(np.argmax(rate)) < 310
    assert rate[5000] == pytest.approx(0.505 * options.learning_rate)
    assert rate[-1] == pytest.approx(0.01 * options.learning_rate)


def test_validation_leaves_the_network_in_its_mode() -> None:
    network = model.SmearUNet(NARROW).train()
    before = [tensor.clone() for tensor in network.state_dict().values()]
    images = torch.rand(34, 3, 32, 32)
    decoded = validation.predict(network, images, torch.device("cpu"))
    assert network.training and decoded.shape == (34, 4, 8, 8)
    for old, new in zip(before, network.state_dict().values(), strict=True):
        assert torch.equal(old, new)
    with torch.no_grad():
        expected = model.ExportedSmear(network.eval())(images[32:])  # rounding depends on the batch
    torch.testing.assert_close(decoded[32:], expected)


def test_defaults_of_the_command_are_those_of_the_options(monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["train", "--train", "a", "--val", "b", "--out", "c"]
    monkeypatch.setattr("sys.argv", words)
    assert train.parse() == TrainOptions(train=Path("a"), val=Path("b"), out=Path("c"))
    monkeypatch.setattr("sys.argv", [*words, "--learning-rate", "0.5", "--steps", "7", "--workers", "0"])
    options = train.parse()
    assert (options.learning_rate, options.steps, options.workers) == (0.5, 7, 0)


def test_crops_that_the_network_cannot_take_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="multiple of 16"):
        options_of(tmp_path, tmp_path, side=100)


def test_workers_make_the_same_batches(shards: Path, tmp_path: Path) -> None:
    scenes: Scenes = load_shards(shards)
    batches = [
        [pair[0] for _, pair in zip(range(2), train.batches_of(scenes, options, first=5), strict=False)]
        for options in (options_of(shards, tmp_path, workers=workers) for workers in (0, 2))
    ]
    for alone, shared in zip(*batches, strict=True):
        assert torch.equal(alone, shared)


def test_training_processes_see_different_crops(shards: Path, tmp_path: Path) -> None:
    scenes, options = load_shards(shards), options_of(shards, tmp_path)
    first, second = (next(train.batches_of(scenes, options, first=0, rank=rank))[0] for rank in (0, 1))
    assert not torch.equal(first, second)


def test_gradients_are_averaged_over_the_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    network = model.SmearUNet(NARROW)
    for k, parameter in enumerate(network.parameters()):
        parameter.grad = torch.full_like(parameter, float(k))
    train.average_gradients(network)  # alone: nothing changes
    assert [float(p.grad.mean()) for p in network.parameters() if p.grad is not None][5] == 5

    def add_the_other_process(flat: torch.Tensor) -> None:
        flat += 10

    monkeypatch.setattr("torch.distributed.is_initialized", lambda: True)
    monkeypatch.setattr("torch.distributed.get_world_size", lambda: 2)
    monkeypatch.setattr("torch.distributed.all_reduce", add_the_other_process)
    train.average_gradients(network)
    for k, parameter in enumerate(network.parameters()):
        assert parameter.grad is not None and (parameter.grad == (k + 10) / 2).all()
