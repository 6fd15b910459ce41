"""Training of the reader: examples made twice are equal, a stopped run ends the same; the whole recipe."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from blur2view.networks.smear_network import SmearNetwork
from blur2view.smears.likelihood import DIRECTIONS
from tools.rendering.shaken import ShakeOptions
from tools.training import reader_data, recipe
from tools.training.pool import Pool, load_shard, mirrored
from tools.training.reader import Reader
from tools.training.reader_data import Sources, cells_of, load_photos, make_shard, write_shards
from tools.training.recipe import Recipe, make
from tools.training.train_reader import ReaderTraining, Run, difference_of, load_average, showing, train

MOVING = partial(ShakeOptions, still_share=0.0, rest_share=0.0, focus_still_share=0.0)

pytestmark = pytest.mark.slow  # the maps of the spectra take seconds


@pytest.fixture(scope="module")
def sources() -> Sources:
    """Return one photograph, of noise of two sizes."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 200, (60, 80, 3)).repeat(8, 0).repeat(8, 1)
    photo = (coarse + rng.integers(0, 56, coarse.shape)).astype(np.uint8)
    return Sources(photos=[photo], scenes=[], rendered_share=0.0)


@pytest.fixture(scope="module")
def shards(tmp_path_factory: pytest.TempPathFactory, sources: Sources) -> Path:
    """Return a folder of two shards of two examples."""
    folder = tmp_path_factory.mktemp("examples")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reader_data, "SHARD_PX", 2 * 640 * 512)
        patch.setattr(reader_data, "ShakeOptions", MOVING)
        write_shards(folder, range(2), sources)
    return folder


def test_shard_depends_on_its_number_alone_and_is_kept(
    shards: Path, sources: Sources, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(reader_data, "SHARD_PX", 2 * 640 * 512)
    monkeypatch.setattr(reader_data, "ShakeOptions", MOVING)
    write_shards(shards, range(2), sources)
    assert capfd.readouterr().out == ""
    once, again = load_shard(shards / "000000.npz"), make_shard(0, sources)
    assert set(again) == {f"{kind}{k}" for kind in "Csdvrt" for k in range(3)}
    for key in again:
        assert once[key].dtype == again[key].dtype and once[key].tobytes() == again[key].tobytes()
        assert np.isfinite(once[key]).all()
    assert once["C0"].tobytes() != load_shard(shards / "000001.npz")["C0"].tobytes()
    for k, (h, w) in enumerate([(16, 20), (8, 10), (4, 5)]):
        assert once[f"C{k}"].shape == (2, h, w, DIRECTIONS, 45) and once[f"s{k}"].shape == (2, h, w, 5)
        assert once[f"d{k}"].shape == (2, h, w, 16, 2) and once[f"v{k}"].shape == (2, h, w, 16)
        assert once[f"r{k}"].shape == (2, h, w, 16) and once[f"t{k}"].shape == (2, h, w)


def test_samples_of_the_truth_lie_in_their_cell() -> None:
    y, x = np.mgrid[:16, :24]
    smears = np.stack([x, y], -1).astype(np.float32)
    d, v = cells_of(smears, 8), cells_of(x < 12, 8)
    assert d.shape == (2, 3, 16, 2) and v.shape == (2, 3, 16)
    np.testing.assert_array_equal(d.mean(2)[1, 2], [20, 12])
    np.testing.assert_array_equal(v.mean(2)[0], [1, 0.5, 0])


def test_photographs_are_read_by_name_and_large_ones_halved(tmp_path: Path) -> None:
    import cv2

    for name, shade, side in (("b", 20, 40), ("a", 10, 3200)):
        assert cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((32, side, 3), shade, np.uint8))
    first, second = load_photos([tmp_path])
    assert (first.shape, second.shape) == ((16, 1600, 3), (32, 40, 3)) and first.max() == 10


def test_batches_have_as_many_cells_of_either_size(shards: Path) -> None:
    large = load_shard(shards / "000000.npz")
    small = {key: array[:, : array.shape[1] // 2, : array.shape[2] // 2] for key, array in large.items()}
    small = {key: array for key, array in small.items() if not key.endswith("2")}
    pool = Pool(shards, 2)
    pool.shards = {0: large, 1: small}
    shapes = {tuple(pool.batch(np.random.default_rng(k), 8)["v0"].shape[:3]) for k in range(8)}
    assert shapes == {(2, 16, 20), (8, 8, 10)}


def test_mirrored_twice_is_the_identity_and_ablated_examples_hide_one_cepstrum(shards: Path) -> None:
    shard = load_shard(shards / "000000.npz")
    row = {key: array[0] for key, array in shard.items()}
    once = mirrored(row)
    np.testing.assert_array_equal(once["C0"][:, 0, 3], row["C0"][:, -1, -3])
    np.testing.assert_array_equal(once["d1"][:, 0, :, 0], -row["d1"][:, -1, :, 0])
    for key, array in mirrored(once).items():
        np.testing.assert_array_equal(array, row[key])
    comb, trend = (showing(kind, shard) for kind in ("comb", "trend"))
    for k in range(3):
        assert comb[f"C{k}"].any() and trend[f"C{k}"].any()
        np.testing.assert_array_equal(comb[f"C{k}"] + trend[f"C{k}"], shard[f"C{k}"])


def test_resumed_run_ends_with_the_weights_of_one_without_a_stop(
    shards: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "whole"
    options = ReaderTraining(train=shards, val=shards, out=out, steps=2, shards=2, batch=2, save_every=1)
    whole = train(options)
    line = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert line["step"] == 2 and line == json.loads((options.out / "log.jsonl").read_text())
    figures = [line["loss"], *line["000000"].values(), *line["000001"].values()]
    assert len(figures) == 15 and np.isfinite(figures).all()

    save = Run.save

    def stopped(run: Run) -> None:
        save(run)
        raise KeyboardInterrupt

    parted = replace(options, out=tmp_path / "parted")
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Run, "save", stopped)
        train(parted)
    train(parted)
    (first, state), (second, resumed) = (load_average(run.out / "last.pt") for run in (options, parted))
    assert state["step"] == resumed["step"] == 2 and state["figures"] == resumed["figures"]
    for one, other in zip(first.state_dict().values(), second.state_dict().values(), strict=True):
        assert torch.equal(one, other)
    assert whole.figures == state["figures"]
    start = Reader().state_dict()
    assert any(not torch.equal(value, start[name]) for name, value in first.state_dict().items())


def test_cells_that_differ_from_those_about_them_count_more() -> None:
    field = torch.zeros(1, 9, 9, 4, 2)
    field[..., 0] = 10
    assert difference_of(field).max() < 1e-4
    assert difference_of(-field * torch.tensor([1.0, -1.0])).max() < 1e-4  # signs mean nothing
    field[0, 4, 4] = torch.tensor([0.0, 10.0])
    assert difference_of(field).argmax() == 4 * 9 + 4 and difference_of(field).max() > 0.9


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> Recipe:
    """Return a recipe of a few scenes, in small files."""
    monkeypatch.setattr(recipe, "SHARD", 2)
    monkeypatch.setattr(recipe, "LARGE", (320, 256))
    monkeypatch.setattr(reader_data, "SHARD_PX", 2 * 320 * 256)
    return Recipe(scenes=2, large_scenes=2, val_scenes=2, shards=1, steps=1, processes=1)


@pytest.mark.slow
def test_recipe_makes_the_smear_network_and_goes_on_where_it_was(
    tmp_path: Path, small: Recipe, capfd: pytest.CaptureFixture[str]
) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    pixels = np.random.default_rng(0).integers(0, 256, (480, 640, 3), np.uint8)
    assert cv2.imwrite(str(photos / "noise.png"), pixels)
    make(small, [photos], tmp_path / "work", tmp_path / "models")
    made = capfd.readouterr().out.count(".npz")
    network = SmearNetwork(tmp_path / "models" / "smear.onnx")
    assert network.info.training["steps"] == 1
    assert network.predict(np.asarray(pixels[:64, :96] / 255, np.float32)).shape == (64, 96)
    make(small, [photos], tmp_path / "work", tmp_path / "models")
    assert made == 5 and ".npz" not in capfd.readouterr().out  # nothing is made twice
