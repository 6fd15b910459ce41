"""The test split on disk: what is written is what was rendered, again and again."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.geometry.sampson import sampson
from blur2view.smears.field import smear_ends
from tools.datasets import testset
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
    scenes = list(testset.read_test_set(folder))
    assert [scene.name for scene in scenes] == ["0000", "0001"]
    for index, scene in zip(INDICES, scenes, strict=True):
        rendering = render(testset.FIRST_SEED + index, OPTIONS)
        for name in ("displacement", "valid", "static", "K", "R", "t"):
            np.testing.assert_array_equal(getattr(scene, name), getattr(rendering, name))
        assert scene.kind == rendering.kind
        if scene.F is not None:
            chosen = scene.valid & scene.static
            ends = smear_ends(scene.midpoints[chosen], scene.displacement[chosen])
            assert np.median(np.sqrt(sampson(scene.F, ends[:, 0], ends[:, 1]))) < 0.5
        assert (scene.F is None) == (rendering.F is None)
        image = cv2.imread(str(scene.image_path))
        assert image is not None and image.shape == (128, 160, 3)


def test_pictures_show_open_middle_and_close(folder: Path) -> None:
    names = sorted(path.name for path in folder.glob("*.png"))
    assert names == [f"{k:04d}{suffix}.png" for k in INDICES for suffix in ("", "_close", "_open")]
    pictures = {name: np.asarray(cv2.imread(str(folder / name))) for name in names}
    sharp, blurred = (cv2.Laplacian(pictures[f"0000{s}.png"], cv2.CV_64F).var() for s in ("_open", ""))
    assert sharp > 2 * blurred
    assert np.abs(pictures["0000_open.png"].astype(int) - pictures["0000_close.png"]).mean() > 5


def test_same_scene_gives_same_files_and_a_finished_one_is_kept(folder: Path, tmp_path: Path) -> None:
    testset.write_scene(0, tmp_path, OPTIONS)
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (folder / path.name).read_bytes(), path.name
    (tmp_path / "0000.png").write_bytes(b"kept")
    testset.write_scene(0, tmp_path, OPTIONS)
    assert (tmp_path / "0000.png").read_bytes() == b"kept"
