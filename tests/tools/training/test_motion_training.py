"""The motion segmentation network learns: examples, batches and loss, runs that resume."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from blur2view.errors import Blur2ViewError
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import estimate
from blur2view.segmentation.features import CHANNELS, motion_features
from blur2view.segmentation.score import motion_score
from tools.datasets.shards import Scenes, training_record
from tools.rendering.render import RenderOptions
from tools.training import export_motion, motion_data, train_motion
from tools.training.motion_data import STATIC, VALID, MotionExamples, examples_of
from tools.training.motion_model import MotionOptions, MotionUNet
from tools.training.train_motion import (
    LEAST_WEIGHT,
    OVERLAP_WEIGHT,
    WITHOUT_WEIGHT,
    MotionRun,
    MotionTraining,
    batch_of,
    chances,
    load_network,
    loss_of,
    mirrored,
    train,
    transposed,
    window,
)

NARROW = MotionOptions(widths=(8, 8, 8, 8), bottom=1)
QUICK = MotionTraining(steps=6, batch=3, size=(32, 64), save_every=2)


@pytest.fixture(autouse=True)
def small_and_alone(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Train a narrow network on one thread: the same sums in the same order. Export it on a small picture."""

    def narrow(options: MotionOptions = NARROW) -> MotionUNet:
        return MotionUNet(options)

    monkeypatch.setattr(train_motion, "MotionUNet", narrow)
    picture = np.random.default_rng(0).random((1, 3, 64, 96), dtype=np.float32)
    monkeypatch.setattr(export_motion, "sample_image", lambda: picture)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def examples(count: int = 6, height: int = 64, width: int = 96) -> MotionExamples:
    """Give photographs of noise; every second has a box that moves.

    Each cell's number is what its pixels, features and labels say, so that a test sees them cut alike.
    """
    rng, cells = np.random.default_rng(0), (height // 4, width // 4)
    labels = np.full((count, *cells), VALID + STATIC, np.uint8)
    labels[::2, 4:10, 6:14] = VALID
    labels[:, :2] -= VALID
    code = np.arange(cells[0] * cells[1]).reshape(cells)
    image = rng.integers(0, 256, (count, height, width, 3)).astype(np.uint8)
    image[..., :2] = np.repeat(np.repeat(np.stack([code // 256, code % 256], -1), 4, 0), 4, 1)
    features = rng.normal(0, 0.3, (count, CHANNELS, *cells)).astype(np.float16)
    features[:, 4] = code
    features[:, 7] = labels & STATIC == 0
    return MotionExamples(image=image, features=features, labels=labels)


def codes(image: NDArray[np.uint8]) -> NDArray[np.int_]:
    """Read the numbers of cells from pixels (H, W, 3)."""
    coded = image[..., :2].astype(int) @ [256, 1]
    grid = coded.reshape(image.shape[0] // 4, 4, image.shape[1] // 4, 4)
    assert (grid == grid[:, :1, :, :1]).all()
    return np.asarray(grid[:, 0, :, 0])


def arrays(run: MotionRun) -> list[NDArray[np.float32]]:
    networks = (run.network, run.average)
    return [tensor.numpy() for network in networks for tensor in network.state_dict().values()]


# ---- examples


def test_examples_survive_a_file(tmp_path: Path) -> None:
    path, made = tmp_path / "folder" / "motion.npz", examples()
    made.save(path)
    read = MotionExamples.load(path)
    assert len(read) == 6 and [file.name for file in path.parent.iterdir()] == ["motion.npz"]
    for name in ("image", "features", "labels"):
        mine, theirs = getattr(made, name), getattr(read, name)
        assert mine.dtype == theirs.dtype
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_array_equal(read.moving.sum((1, 2)), [48, 0] * 3)


@pytest.mark.parametrize("content", [None, b"", b"no archive", "another archive", "an array"])
def test_file_without_examples_is_named(tmp_path: Path, content: bytes | str | None) -> None:
    path = tmp_path / "motion.npz"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content == "another archive":
        np.savez(path, image=np.zeros(3))
    elif content == "an array":
        with path.open("wb") as file:
            np.save(file, np.zeros(3))
    with pytest.raises(Blur2ViewError, match="no examples in .*: run python -m tools.training.motion_data"):
        MotionExamples.load(path)


@pytest.fixture(scope="module")
def shard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Render two small scenes, of which the second has something that moves."""
    folder = tmp_path_factory.mktemp("scenes")
    sizes = {"size": (96, 64), "smear_px": (4.0, 16.0)}
    parts = [
        training_record(seed, RenderOptions(**sizes, mover_share=share))  # type: ignore[arg-type]
        for seed, share in ((0, 0.0), (7, 1.0))
    ]
    assert [bool((part.labels & STATIC == 0).mean() > 0.05) for part in parts] == [False, True]
    path = folder / "train_00000040.npz"
    Scenes.join(parts).save(path)
    return path


def test_examples_are_photographs_with_the_features_of_their_estimates(
    shard: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(motion_data, "KEPT_WITHOUT", 0.0)
    ((image, features, label),) = examples_of(shard)  # only the one with a mover
    with np.load(shard) as stored:
        np.testing.assert_array_equal(label, stored["labels"][1])
        linear = stored["linear"][1]
    assert image.shape == (64, 96, 3) and image.dtype == np.uint8 and features.dtype == np.float16
    found = estimate(np.asarray(image / 255, np.float32), network=SmearNetwork(threads=1))
    expected = motion_features(found, motion_score(found)).astype(np.float16)
    np.testing.assert_array_equal(features, expected)
    assert features.shape == (CHANNELS, *label.shape)
    correlation = np.corrcoef(np.sqrt(linear.mean(-1).ravel()), image.mean(-1).ravel())[0, 1]
    assert correlation > 0.7
    monkeypatch.setattr(motion_data, "KEPT_WITHOUT", 1.0)
    both = examples_of(shard)
    assert len(both) == 2
    for mine, theirs in zip(both[1], (image, features, label), strict=True):
        np.testing.assert_array_equal(mine, theirs)  # whichever others are kept


def test_command_makes_examples_of_a_folder(
    shard: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "motion.npz"
    monkeypatch.setattr("sys.argv", ["motion_data", str(shard.parent), str(out), "--processes", "1"])
    motion_data.main()
    assert capsys.readouterr().out == "shard 1 of 1\n"
    made = MotionExamples.load(out)
    assert made.moving.any() and made.image.shape == (len(made), 64, 96, 3)
    assert made.features.shape == (len(made), CHANNELS, 16, 24)


def test_command_names_a_folder_without_scenes_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["motion_data", str(tmp_path), str(tmp_path / "motion.npz")])
    with pytest.raises(SystemExit, match=r"^no scenes in .*$"):
        motion_data.main()


def test_folder_in_which_nothing_is_kept_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def pool(*_: object) -> Iterator[SimpleNamespace]:
        """Do in this process what other processes would."""
        yield SimpleNamespace(imap=map)

    monkeypatch.setattr("multiprocessing.get_context", lambda _: SimpleNamespace(Pool=pool))
    monkeypatch.setattr(motion_data, "examples_of", lambda *_, **__: [])
    (tmp_path / "train_00000000.npz").write_bytes(b"")
    with pytest.raises(Blur2ViewError, match="nothing moves in the scenes of"):
        motion_data.make(tmp_path, 1)


# ---- batches


def test_mirroring_and_transposing_undo_themselves() -> None:
    made = examples(1)
    one = made.image[0], made.features[0].astype(np.float32), made.labels[0]
    once = [mirrored(*one, 0), mirrored(*one, 1), transposed(*one)]
    twice = [mirrored(*once[0], 0), mirrored(*once[1], 1), transposed(*once[2])]
    for first, second in zip(once, twice, strict=True):
        for mine, theirs, original in zip(first, second, one, strict=True):
            np.testing.assert_array_equal(theirs, original)
            assert mine.shape != original.shape or (mine != original).any()


def test_windows_cut_pixels_features_and_labels_alike() -> None:
    made, seen = examples(), set()
    whole = codes(made.image[0])
    for seed in range(60):
        image, features, labels = window(np.random.default_rng(seed), made, 0, (32, 64))
        found = codes(image)
        assert image.shape == (32, 64, 3) and found.shape == labels.shape == (8, 16)
        np.testing.assert_array_equal(features[4], found)
        row, column = np.unravel_index(found.min(), whole.shape)
        cut = whole[row : row + 8, column : column + 16]
        flips = int(found[0, 0] > found[-1, 0]), int(found[0, 0] > found[0, -1])
        np.testing.assert_array_equal(found, cut[:: 1 - 2 * flips[0], :: 1 - 2 * flips[1]])
        np.testing.assert_array_equal(labels, made.labels[0].ravel()[found])
        sign = (-1) ** sum(flips)
        for channel in range(4):
            expected = made.features[0, channel].ravel()[found] * (sign if channel in (1, 3) else 1)
            np.testing.assert_array_equal(features[channel], expected)
        seen.add((int(row), int(column), *flips))
    assert {place[:2] for place in seen} == {(row, column) for row in (0, 4, 8) for column in (0, 4, 8)}
    assert {place[2:] for place in seen} == {(0, 0), (0, 1), (1, 0), (1, 1)}


def test_batches_depend_on_nothing_but_seed_and_number() -> None:
    made = examples()
    chance = chances(made)
    one = [batch_of(made, chance, QUICK, step) for step in range(4)]
    for step in (2, 0):
        for mine, theirs in zip(batch_of(made, chance, QUICK, step), one[step], strict=True):
            assert torch.equal(mine, theirs)
    other = batch_of(made, chance, replace(QUICK, seed=1), 0)
    assert not torch.equal(one[0][1].flatten(), other[1].flatten())
    assert not torch.equal(one[0][1].flatten(), one[1][1].flatten())


def test_batches_hold_shares_of_white_and_are_transposed_by_chance() -> None:
    made, shapes = examples(), set()
    for step in range(12):
        image, features, labels = batch_of(made, chances(made), QUICK, step)
        assert image.dtype == features.dtype == torch.float32 and image.is_contiguous()
        assert 0.9 < image[:, 2].max() <= 1 and image.min() == 0
        assert features.shape == (3, CHANNELS, *labels.shape[1:])
        assert image.shape == (3, 3, 4 * labels.shape[1], 4 * labels.shape[2])
        coded = torch.nn.functional.avg_pool2d(image[:, :2] * 255, 4).round()
        torch.testing.assert_close(256 * coded[:, 0] + coded[:, 1], features[:, 4])
        torch.testing.assert_close((labels & STATIC == 0).float(), features[:, 7])
        shapes.add(tuple(labels.shape[1:]))
    assert shapes == {(8, 16), (16, 8)}


def test_photographs_without_a_mover_are_drawn_more_seldom() -> None:
    made = examples(5)
    chance = chances(made)
    assert chance.sum() == pytest.approx(1)
    np.testing.assert_allclose(chance / chance[0], [1, WITHOUT_WEIGHT, 1, WITHOUT_WEIGHT, 1])


# ---- loss


def loss_at(logits: list[float], labels: list[int]) -> float:
    """Loss of pictures of one cell each."""
    cells = torch.tensor(labels, dtype=torch.uint8)[:, None, None]
    return float(loss_of(torch.tensor(logits)[:, None, None, None], cells))


def test_loss_of_a_cell_is_its_cross_entropy_and_overlap() -> None:
    z = 0.7
    share = 1 / (1 + math.exp(-z))
    moving = -math.log(share) + OVERLAP_WEIGHT * (1 - (share + 1) / 2)
    assert loss_at([z], [VALID]) == pytest.approx(moving, rel=1e-5)
    unsure = -LEAST_WEIGHT * math.log(share)
    unsure += OVERLAP_WEIGHT * (1 - (LEAST_WEIGHT * share + 1) / (LEAST_WEIGHT + 1))
    assert loss_at([z], [0]) == pytest.approx(unsure, rel=1e-5)
    static = -math.log(1 - share)
    assert loss_at([z], [VALID + STATIC]) == pytest.approx(static + OVERLAP_WEIGHT, rel=1e-5)
    assert loss_at([z], [STATIC]) == pytest.approx(LEAST_WEIGHT * static + OVERLAP_WEIGHT, rel=1e-5)
    # of two pictures the cross entropy is averaged, and the overlap is that of the one with a mover
    entropy = (static - math.log(share)) / 2
    both = entropy + OVERLAP_WEIGHT * (1 - (share + 1) / 2)
    assert loss_at([z, z], [VALID + STATIC, VALID]) == pytest.approx(both, rel=1e-5)


def test_loss_of_a_perfect_answer_is_nothing_and_of_a_wrong_one_much() -> None:
    labels = torch.from_numpy(examples(1).labels)
    right = torch.where(labels & STATIC == 0, 20.0, -20.0)[:, None]
    assert float(loss_of(right, labels)) < 1e-6
    assert float(loss_of(-right, labels)) > 10
    assert float(loss_of(-right[:, :, :2], labels[:, :2])) < 5  # smears unknown


# ---- runs


def test_rate_rises_then_falls_to_a_hundredth() -> None:
    plan = MotionTraining(steps=1000, learning_rate=1.0)
    assert plan.rate_at(0) == pytest.approx(1 / train_motion.WARM_UP_STEPS)
    assert plan.rate_at(99) == pytest.approx(0.5 * (0.01 + 0.99 * 0.5 * (1 + math.cos(0.099 * math.pi))))
    assert plan.rate_at(500) == pytest.approx(0.01 + 0.99 / 2)
    assert plan.rate_at(1000) == plan.rate_at(1100) == pytest.approx(0.01)


def test_a_few_steps_lower_the_loss(tmp_path: Path) -> None:
    made = examples()
    batch = batch_of(made, chances(made), QUICK, 0)
    run = MotionRun.start(QUICK, tmp_path / "none.pt", 1)
    run.network.train()
    losses = [run.advance(batch, 2e-3) for _ in range(25)]
    assert np.mean(losses[-3:]) < 0.6 * np.mean(losses[:3]) and run.step == 25
    assert run.optimiser.param_groups[0]["lr"] == 2e-3


def test_resumed_run_equals_an_uninterrupted_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made, calls = examples(), 0
    whole = train(made, QUICK, tmp_path / "whole.pt")
    plain = MotionRun.advance

    def killed_in_step_four(run: MotionRun, *arguments: object) -> float:
        nonlocal calls
        calls += 1
        if calls == 4:
            raise KeyboardInterrupt
        return plain(run, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(MotionRun, "advance", killed_in_step_four)
    with pytest.raises(KeyboardInterrupt):
        train(made, QUICK, tmp_path / "parts.pt")
    assert torch.load(tmp_path / "parts.pt", weights_only=True)["step"] == 2
    resumed = train(made, QUICK, tmp_path / "parts.pt")
    assert calls == 4 + 4 and resumed.step == whole.step == 6
    for mine, theirs in zip(arrays(resumed), arrays(whole), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert not torch.equal(whole.average.head.weight, whole.network.head.weight)
    again = train(made, QUICK, tmp_path / "parts.pt")
    assert calls == 8 and again.step == 6  # nothing is left to do
    assert capsys.readouterr().out.count("step 6, loss") == 2


def test_average_follows_the_weights(tmp_path: Path) -> None:
    made, run = examples(), MotionRun.start(QUICK, tmp_path / "none.pt", 1)
    before = run.average.head.weight.clone()
    torch.testing.assert_close(run.network.head.weight, before, rtol=0, atol=0)
    run.network.train()
    run.advance(batch_of(made, chances(made), QUICK, 0), 0.1)
    after, decay = run.network.head.weight, 2 / 11  # (1 + step) / (10 + step)
    assert (after - before).abs().max() > 0.05
    torch.testing.assert_close(run.average.head.weight, decay * before + (1 - decay) * after)


def test_weights_follow_from_the_seed(tmp_path: Path) -> None:
    first, same, other = (MotionRun.start(replace(QUICK, seed=k), tmp_path / "none.pt", 1) for k in (3, 3, 4))
    for mine, theirs in zip(arrays(first), arrays(same), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert not torch.equal(first.network.head.weight, other.network.head.weight)


def test_checkpoint_gives_its_averaged_network(tmp_path: Path) -> None:
    run = MotionRun.start(QUICK, tmp_path / "none.pt", 1)
    with torch.no_grad():
        run.average.head.weight.add_(1)
    run.step = 7
    run.save(tmp_path / "folder" / "run.pt", QUICK, 12)
    network, state = load_network(tmp_path / "folder" / "run.pt")
    assert not network.training and network.options == NARROW
    assert torch.equal(network.head.weight, run.average.head.weight)
    assert not torch.equal(network.head.weight, run.network.head.weight)
    assert state["step"] == 7 and state["training"] == {"seed": 0, "batch": 3, "examples": 12}
    assert [path.name for path in (tmp_path / "folder").iterdir()] == ["run.pt"]


def test_windows_larger_than_the_photographs_are_refused(tmp_path: Path) -> None:
    for size in ((80, 64), (32, 112)):
        with pytest.raises(
            Blur2ViewError, match=f"photographs of 96x64 pixels, windows of {size[1]}x{size[0]}"
        ):
            train(examples(), replace(QUICK, size=size), tmp_path / "run.pt")
    assert train(examples(), replace(QUICK, size=(64, 96), steps=1), tmp_path / "run.pt").step == 1


def bad_checkpoint(path: Path, kind: str) -> Path:
    """Write a file that is no checkpoint of the motion segmentation network."""
    if kind == "damaged":
        path.write_bytes(b"PK no archive")
    elif kind == "folder":
        path.mkdir()
    elif kind == "other":
        torch.save(
            {"network": {}, "average": {}, "model_options": {"widths": (8,), "bottom": 1}, "step": 1}, path
        )
    elif kind == "list":
        torch.save([1, 2], path)
    return path


@pytest.mark.parametrize("kind", ["damaged", "folder", "other", "list"])
def test_training_does_not_go_on_from_what_is_no_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    examples(2, 192, 256).save(tmp_path / "motion.npz")
    last = bad_checkpoint(tmp_path / "run.pt", kind)
    monkeypatch.setattr("sys.argv", ["train_motion", str(tmp_path / "motion.npz"), str(last)])
    with pytest.raises(SystemExit, match=r"^.*run.pt: is no checkpoint to go on from.*$"):
        train_motion.main()


def test_training_does_not_go_on_with_another_seed_or_fewer_steps(tmp_path: Path) -> None:
    made = examples()
    train(made, replace(QUICK, steps=2), tmp_path / "run.pt")
    with pytest.raises(Blur2ViewError, match=r"run.pt: is of another training .*'seed': 0.*not.*'seed': 1"):
        train(made, replace(QUICK, steps=2, seed=1), tmp_path / "run.pt")
    with pytest.raises(Blur2ViewError, match="run.pt has made 2 steps, more than 1"):
        train(made, replace(QUICK, steps=1), tmp_path / "run.pt")


def test_training_command_trains_and_names_missing_examples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(tmp_path / "motion.npz"), str(tmp_path / "runs" / "run.pt")]
    monkeypatch.setattr("sys.argv", ["train_motion", *files, "--steps", "1", "--seed", "5"])
    with pytest.raises(SystemExit, match=r"^no examples in .*motion.npz.*$"):
        train_motion.main()
    examples(2, 192, 256).save(tmp_path / "motion.npz")
    train_motion.main()
    assert capsys.readouterr().out.startswith("step 1, loss ")
    _, state = load_network(tmp_path / "runs" / "run.pt")
    assert state["training"] == {"seed": 5, "batch": MotionTraining.batch, "examples": 2}


# ---- export
