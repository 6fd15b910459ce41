"""Rendered sets on disk hold what was rendered, the same bytes for the same seed."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tools.datasets import testset
from tools.rendering.render import RenderOptions, render

SIZE = (160, 128)
OPTIONS = RenderOptions(size=SIZE)


def test_scenes_read_back_are_those_rendered_and_finished_ones_are_kept(tmp_path: Path) -> None:
    testset.write_scene(("", 0), tmp_path, OPTIONS)
    ((scene,), rendering) = testset.read_test_set(tmp_path), render(testset.FIRST_SEED, OPTIONS)
    for name in (*testset.ARRAYS, "kind"):
        np.testing.assert_array_equal(getattr(scene, name), getattr(rendering, name))
    assert (scene.F is None) == (rendering.F is None) and scene.image.shape == (128, 160, 3)
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert set(files) == {"0000.npz", "0000.png", "0000_open.png", "0000_close.png"}
    for path in tmp_path.iterdir():
        path.unlink()
    testset.write_scene(("", 0), tmp_path, OPTIONS)
    assert files == {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    (tmp_path / "0000.png").write_bytes(b"kept")
    testset.write_scene(("", 0), tmp_path, OPTIONS)
    assert (tmp_path / "0000.png").read_bytes() == b"kept"


def test_kinds_are_written_by_kind_and_seed(tmp_path: Path) -> None:
    for kind in testset.KINDS:
        testset.write_scene((kind, 7), tmp_path, RenderOptions(size=(96, 72)))
        (scene,) = testset.read_test_set(tmp_path / kind)
        assert scene.name == "00007" and cv2.imread(str(scene.image_path)) is not None
        assert scene.static.all()
        assert (scene.F is None) == (kind == "rotation" or not scene.t.any())
        assert scene.median_px < 1 if kind == "still" else 4 <= scene.median_px <= 60
        if kind in ("plane", "general"):
            share = testset.off_plane(scene)
            assert share < 0.01 if kind == "plane" else share >= testset.MIN_PARALLAX


def test_a_folder_without_scenes_names_the_command_that_makes_them(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"run python -m tools\.datasets\.testset"):
        testset.read_test_set(tmp_path)
