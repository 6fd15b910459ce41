"""The recipe of the shipped networks, from nothing to all three files, in miniature."""

from pathlib import Path

import numpy as np
import pytest

from blur2view.networks.smear_network import SmearNetwork
from blur2view.segmentation.network import MotionNetwork
from tools.training import recipe, validation
from tools.training.recipe import Recipe, make
from tools.training.train_motion import MotionTraining


def test_recipe_makes_all_networks_and_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(recipe, "SHARD", 4)
    monkeypatch.setattr(validation, "CROPS", 4)
    small = Recipe(
        scenes=4,
        val_scenes=4,
        size=(64, 64),
        steps=2,
        more_steps=3,
        processes=1,
        calibration_scenes=1,
        motion=MotionTraining(steps=2, batch=2, size=(64, 64)),
    )
    make(small, None, tmp_path / "work", tmp_path / "models")
    rendered = capfd.readouterr().out.count(".npz")
    names = {None: "smear.onnx", "fast": "smear_fast.onnx"}
    image = np.random.default_rng(0).random((64, 96, 3), dtype=np.float32)
    for name in names.values():
        network = SmearNetwork(tmp_path / "models" / name)
        assert network.info.training["steps"] == 5 and network.info.training["scenes"] == 4
        assert network.predict(image).shape == (64, 96)
    assert MotionNetwork(tmp_path / "models" / "motion.onnx").info.stride == 4
    make(small, None, tmp_path / "work", tmp_path / "models")
    assert rendered == 2 and ".npz" not in capfd.readouterr().out  # nothing is rendered twice
