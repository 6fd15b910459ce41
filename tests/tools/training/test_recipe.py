"""The recipe of the shipped network, in miniature."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.networks.smear_network import SmearNetwork
from tools.training import reader_data, recipe
from tools.training.recipe import Recipe, make


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
