"""Rendered sets on disk: what is written is what was rendered, again and again, and goes on where it was."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.geometry.epipolar import sampson
from tools.datasets import testset
from tools.datasets.motion_kinds import KINDS, LEAST_PARALLAX, motion_scene, off_plane
from tools.rendering.render import render

SIZE = (160, 128)
OPTIONS = testset.test_options(None, SIZE)
INDICES = (0, 1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("test_split")
    for index in INDICES:
        testset.write_scene(index, path, OPTIONS)
    return path


def test_scenes_read_back_are_those_rendered(folder: Path) -> None:
    scenes = testset.read_test_set(folder)
    assert [scene.name for scene in scenes] == ["0000", "0001"]
    for index, scene in zip(INDICES, scenes, strict=True):
        rendering = render(testset.FIRST_SEED + index, OPTIONS)
        for name in ("displacement", "valid", "static", "K", "R", "t"):
            np.testing.assert_array_equal(getattr(scene, name), getattr(rendering, name))
        assert scene.kind == rendering.kind
        if scene.F is not None:
            ends = scene.true_ends
            assert np.median(np.sqrt(sampson(scene.F, ends[:, 0], ends[:, 1]))) < 0.5
        assert (scene.F is None) == (rendering.F is None)
        image = cv2.imread(str(scene.image_path))
        assert image is not None and image.shape == (128, 160, 3)


def test_same_scene_gives_same_files_and_a_finished_one_is_kept(folder: Path, tmp_path: Path) -> None:
    testset.write_scene(0, tmp_path, OPTIONS)
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (folder / path.name).read_bytes(), path.name
    (tmp_path / "0000.png").write_bytes(b"kept")
    testset.write_scene(0, tmp_path, OPTIONS)
    assert (tmp_path / "0000.png").read_bytes() == b"kept"


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_is_what_it_says(kind: str) -> None:
    scene = motion_scene(kind, 7, None, (96, 72))
    share = off_plane(scene)
    assert scene.static.all()
    assert (scene.F is None) == (kind == "rotation" or not scene.t.any())
    if kind == "still":
        assert scene.median_px < 1
    else:
        assert 4 <= scene.median_px <= 60
        assert share < 0.01 if kind != "general" else share >= LEAST_PARALLAX
