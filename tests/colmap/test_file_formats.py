"""COLMAP's text formats and hloc's files, read back as their readers do; what both refuse."""

import os
import resource
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import h5py
import numpy as np
import pycolmap
import pytest

from blur2view.colmap.hloc_files import certainty, matches0, write_hloc
from blur2view.colmap.text_formats import keypoints_text, matches_text, write_matches_text
from blur2view.errors import OutputError
from blur2view.exposure.views import ExposureViews
from tests.support.scenes import some_views

Write = Callable[[Path, Sequence[ExposureViews]], list[Path]]
SEQUENCE = [some_views("left/one.jpg", 5, 1), some_views("two.jpg", 7, 2)]


def write_text(folder: Path, sequence: Sequence[ExposureViews]) -> list[Path]:
    """Write COLMAP's text formats, of photographs that hold their names."""
    photographs = [folder.parent / Path(views.name).name for views in sequence]
    for path in photographs:
        path.write_bytes(path.name.encode())
    return write_matches_text(folder, sequence, photographs)


def imported_matches(text: str) -> Iterator[tuple[str, str, list[tuple[int, int]]]]:
    """Read as matches_importer does: blocks of a line of two names, then pairs up to a blank line."""
    for block in text.removesuffix("\n\n").split("\n\n"):
        names, *rows = block.splitlines()
        name1, name2 = names.split()
        pairs = [tuple(map(int, row.split())) for row in rows]
        yield name1, name2, [(index1, index2) for index1, index2 in pairs]


def imported_keypoints(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Read as feature_importer does: counts, then x y scale orientation, 128 bytes; give four."""
    header, *rows = text.splitlines()
    count, dimension = map(int, header.split())
    values = np.array([list(map(float, row.split())) for row in rows]).reshape(count, 4 + dimension)
    assert dimension == 128 and ((values[:, 4:] >= 0) & (values[:, 4:] <= 255)).all()
    return values[:, :2], values[:, 2:4]


def test_keypoints_are_colmaps_pixels() -> None:
    points = np.array([[0.0, 0.0], [10.25, 3.5]])
    read, shape = imported_keypoints(keypoints_text(points))
    np.testing.assert_allclose(read, points + 0.5, atol=1e-6)
    np.testing.assert_array_equal(shape, [[1, 0], [1, 0]])
    assert keypoints_text(np.zeros((0, 2))) == "0 128\n"


def test_inliers_alone_are_matched_each_with_itself_without_a_geometry_nothing() -> None:
    views = some_views(count=6)
    blocks = list(imported_matches(matches_text(views)))
    assert blocks == [("a.jpg#open", "a.jpg#close", [(1, 1), (2, 2), (4, 4), (5, 5)])]
    none = replace(views, geometry=replace(views.geometry, F=None, inlier_mask=np.zeros(6, bool)))
    assert list(imported_matches(matches_text(none))) == [("a.jpg#open", "a.jpg#close", [])]


def test_all_texts_of_a_call_fit_each_other(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for _ in range(2):  # a second call replaces the first
        written = write_text(out, SEQUENCE)
    assert written == [out / "matches.txt", out / "keypoints", out / "images"]
    blocks = list(imported_matches((out / "matches.txt").read_text()))
    assert [block[0] for block in blocks] == ["left/one.jpg#open", "two.jpg#open"]
    for views, (name1, name2, pairs) in zip(SEQUENCE, blocks, strict=True):
        for name, points in ((name1, views.points_open), (name2, views.points_close)):
            read, _ = imported_keypoints((out / "keypoints" / f"{name}.txt").read_text())
            np.testing.assert_allclose(read, points + 0.5, atol=1e-6)
            assert max(index for pair in pairs for index in pair) < len(read)
            assert (out / "images" / name).read_text() == Path(views.name).name
    assert len([path for path in out.rglob("*") if path.is_file()]) == 1 + 4 + 4  # nothing else is left


def test_a_later_call_leaves_no_views_of_an_earlier_one_and_nothing_else_is_lost(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_text(out, SEQUENCE)
    (out / "keypoints" / "note#1.txt").write_text("kept")
    write_text(out, SEQUENCE[1:])
    left = {path.name for path in out.rglob("*") if path.is_file() or path.is_symlink()}
    views = {"two.jpg#close", "two.jpg#close.txt", "two.jpg#open", "two.jpg#open.txt"}
    assert left == {"matches.txt", "note#1.txt"} | views
    assert (tmp_path / "one.jpg").read_bytes() and (tmp_path / "two.jpg").read_bytes()


def test_pycolmap_imports_the_pictures_under_the_views_names(tmp_path: Path) -> None:
    photograph = tmp_path / "a.jpg"
    cv2.imwrite(str(photograph), np.full((100, 120, 3), 90, np.uint8))
    write_matches_text(tmp_path / "out", [some_views()], [photograph])
    database = tmp_path / "new.db"
    pycolmap.Database.open(database).close()
    pycolmap.import_images(database, tmp_path / "out" / "images")
    with pycolmap.Database.open(database) as opened:
        images = {image.name: image.camera_id for image in opened.read_all_images()}
        sizes = {(opened.read_camera(i).width, opened.read_camera(i).height) for i in images.values()}
    assert set(images) == {"a.jpg#open", "a.jpg#close"} and sizes == {(120, 100)}


def hloc_matches(path: Path, name0: str, name1: str) -> tuple[np.ndarray, np.ndarray]:
    """Find a pair and turn matches0 into index pairs with scores, as hloc.utils.io.get_matches does."""
    with h5py.File(path, "r") as file:
        group = file[name0.replace("/", "-") + "/" + name1.replace("/", "-")]
        matches, scores = group["matches0"][:], group["matching_scores0"][:]
    index = np.flatnonzero(matches != -1)
    return np.stack([index, matches[index]], axis=1), scores[index]


def test_hloc_finds_keypoints_and_matches_by_name(tmp_path: Path) -> None:
    for _ in range(2):  # a second call replaces the first
        features, matches, pairs = write_hloc(tmp_path / "out", SEQUENCE)
    listed = [line.split() for line in pairs.read_text().splitlines()]
    assert listed == [list(views.names) for views in SEQUENCE]
    for views in SEQUENCE:
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
    assert len(list((tmp_path / "out").iterdir())) == 3


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


@pytest.mark.parametrize("write", [write_text, write_hloc])
def test_a_folder_that_takes_no_files_is_named(tmp_path: Path, write: Write) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(OutputError, match="out: cannot be written"):
        write(tmp_path / "out", SEQUENCE)


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
        ("matches.txt", b"a.jpg b.jpg\n0 0\n\n"),
        *((name, None) for name in ("features.h5", "matches.h5", "pairs.txt", "matches.txt")),
    ],
)
def test_files_of_others_are_refused_and_stay(
    tmp_path: Path, name: str, content: bytes | dict[str, str] | None
) -> None:
    path = tmp_path / "out" / name
    path.parent.mkdir()
    if content is None:
        os.mkfifo(path)  # which is not waited for
    elif isinstance(content, bytes):
        path.write_bytes(content)
    else:
        with h5py.File(path, "w") as file:
            for group, dataset in content.items():
                file.require_group(group).create_dataset(dataset, data=[1.0])
    before = content is None or path.read_bytes()
    with pytest.raises(OutputError, match=rf"{name}: (holds more than views|cannot be read \(is no regular)"):
        (write_text if name == "matches.txt" else write_hloc)(path.parent, SEQUENCE)
    assert content is None or path.read_bytes() == before
    assert [file.name for file in path.parent.iterdir()] == [name]


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
