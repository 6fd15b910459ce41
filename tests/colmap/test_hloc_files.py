"""hloc's files, read back as hloc's own readers do."""

import os
import resource
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from blur2view.colmap.hloc_files import certainty, matches0, write_hloc
from blur2view.errors import OutputError
from tests.support.scenes import some_views


def hloc_matches(path: Path, name0: str, name1: str) -> tuple[np.ndarray, np.ndarray]:
    """Find a pair and turn matches0 into index pairs with scores, as hloc.utils.io.get_matches does."""
    with h5py.File(path, "r") as file:
        group = file[name0.replace("/", "-") + "/" + name1.replace("/", "-")]
        matches, scores = group["matches0"][:], group["matching_scores0"][:]
    index = np.flatnonzero(matches != -1)
    return np.stack([index, matches[index]], axis=1), scores[index]


def test_hloc_finds_keypoints_and_matches_by_name(tmp_path: Path) -> None:
    sequence = [some_views("left/one.jpg", 7, 1), some_views("two.jpg", 5, 2)]
    for _ in range(2):  # a second call replaces the first
        features, matches, pairs = write_hloc(tmp_path / "out", sequence)
    listed = [line.split() for line in pairs.read_text().splitlines()]
    assert listed == [list(views.names) for views in sequence]
    for views in sequence:
        index, scores = hloc_matches(matches, *views.names)
        inliers = np.flatnonzero(views.geometry.inlier_mask)
        np.testing.assert_array_equal(index, np.stack([inliers, inliers], axis=1))
        assert ((scores > 0) & (scores <= 1)).all()
        with h5py.File(features, "r") as file:
            for name, points in zip(views.names, (views.points_open, views.points_close), strict=True):
                group = file[name]
                np.testing.assert_allclose(group["keypoints"][:], points, atol=1e-5)  # no half pixel here
                assert group["keypoints"].attrs["uncertainty"] == pytest.approx(np.median(views.sigma_px) / 2)
                assert group["image_size"][:].tolist() == [120, 100]
                assert group["scores"].shape == (len(points),)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "features.h5",
        "matches.h5",
        "pairs.txt",
    ]


def test_certain_smears_score_higher_and_outliers_are_unmatched() -> None:
    views = some_views(count=50)
    scores = certainty(views)[np.argsort(views.sigma_px)]
    assert (np.diff(scores) <= 0).all() and scores[0] > scores[-1]
    assert matches0(some_views(count=5)).tolist() == [-1, 1, 2, -1, 4]


def test_without_h5py_the_remedy_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(OutputError, match="pip install h5py"):
        write_hloc(tmp_path / "out", [some_views()])
    assert not (tmp_path / "out").exists()


def test_a_blank_in_a_name_and_a_folder_that_takes_no_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    for name, words in (("my photo.jpg", "blank"), ("a.jpg", "out: cannot be written")):
        with pytest.raises(OutputError, match=words):
            write_hloc(tmp_path / "out", [some_views(name)])
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_photograph_named_twice_is_refused_and_older_files_stay(tmp_path: Path) -> None:
    write_hloc(tmp_path / "out", [some_views()])
    before = (tmp_path / "out" / "matches.h5").read_bytes()
    with pytest.raises(OutputError, match=r"a\.jpg: is there twice"):
        write_hloc(tmp_path / "out", [some_views(), some_views()])
    assert (tmp_path / "out" / "matches.h5").read_bytes() == before
    assert len(list((tmp_path / "out").iterdir())) == 3


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("features.h5", {"db/1.jpg": "keypoints"}),
        ("features.h5", {"a.jpg#open": "keypoints", "a.jpg": "keypoints"}),
        ("matches.h5", {"a.jpg/b.jpg": "matches0"}),
        ("matches.h5", {"a.jpg#open/b.jpg": "matches0"}),
        ("features.h5", {"/": "a dataset at the top"}),
        ("pairs.txt", b"a.jpg b.jpg\n"),
        ("features.h5", b"no HDF5"),
        ("matches.h5", b""),
    ],
)
def test_files_of_others_are_refused_and_stay(
    tmp_path: Path, name: str, content: bytes | dict[str, str]
) -> None:
    path = tmp_path / "out" / name
    path.parent.mkdir()
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        with h5py.File(path, "w") as file:
            for group, dataset in content.items():
                file.require_group(group).create_dataset(dataset, data=[1.0])
    before = path.read_bytes()
    with pytest.raises(OutputError, match=f"{name}: holds more than views"):
        write_hloc(tmp_path / "out", [some_views()])
    assert path.read_bytes() == before and [file.name for file in path.parent.iterdir()] == [name]


@pytest.mark.parametrize("name", ["pairs.txt", "features.h5", "matches.h5"])
def test_a_pipe_is_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(OutputError, match="holds more than views"):
        write_hloc(tmp_path, [some_views()])


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    child = os.fork()
    if child == 0:  # the limit holds for a whole process
        resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))
        try:
            write_hloc(tmp_path / "out", [some_views(count=500)])
        except OutputError as error:
            os._exit(7 if "out: cannot be written (File too large)" in str(error) else 8)
        finally:
            os._exit(9)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    assert list((tmp_path / "out").iterdir()) == []
