"""COLMAP's text formats, read back as COLMAP's documentation and readers have them."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from blur2view.colmap.text_formats import keypoints_text, matches_text, write_matches_text
from blur2view.errors import OutputError
from tests.support.scenes import some_views


def imported_matches(text: str) -> Iterator[tuple[str, str, list[tuple[int, int]]]]:
    """Read as matches_importer does: blocks of a line of two names, then pairs up to a blank line."""
    lines = iter(text.splitlines())
    for line in lines:
        if not line.strip():
            continue
        name1, name2 = line.split()
        pairs = []
        for row in lines:
            if not row.strip():
                break
            index1, index2 = map(int, row.split())
            pairs.append((index1, index2))
        yield name1, name2, pairs


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


def test_inliers_alone_are_matched_each_with_itself() -> None:
    blocks = list(imported_matches(matches_text(some_views(count=6))))
    assert blocks == [("a.jpg#open", "a.jpg#close", [(1, 1), (2, 2), (4, 4), (5, 5)])]


def test_all_files_of_a_call_fit_each_other(tmp_path: Path) -> None:
    photographs = [tmp_path / "one.jpg", tmp_path / "two.jpg"]
    for path in photographs:
        path.write_bytes(path.name.encode())
    sequence = [some_views("left/one.jpg", 5, 1), some_views("two.jpg", 7, 2)]
    out = tmp_path / "out"
    for _ in range(2):  # a second call replaces the first
        written = write_matches_text(out, sequence, photographs)
    assert written == [out / "matches.txt", out / "keypoints", out / "images"]
    blocks = list(imported_matches((out / "matches.txt").read_text()))
    assert [block[0] for block in blocks] == ["left/one.jpg#open", "two.jpg#open"]
    for views, (name1, name2, pairs), photograph in zip(sequence, blocks, photographs, strict=True):
        for name, points in ((name1, views.points_open), (name2, views.points_close)):
            read, _ = imported_keypoints((out / "keypoints" / f"{name}.txt").read_text())
            np.testing.assert_allclose(read, points + 0.5, atol=1e-6)
            assert max(index for pair in pairs for index in pair) < len(read)
            assert (out / "images" / name).read_bytes() == photograph.read_bytes()
    assert len([path for path in out.rglob("*") if path.is_file()]) == 1 + 4 + 4  # nothing else is left


def test_a_later_call_leaves_no_views_of_an_earlier_one_and_nothing_else_is_lost(tmp_path: Path) -> None:
    photographs = [tmp_path / "one.jpg", tmp_path / "two.jpg"]
    for path in photographs:
        path.write_bytes(path.name.encode())
    out = tmp_path / "out"
    write_matches_text(out, [some_views("left/one.jpg", 5, 1), some_views("two.jpg", 7, 2)], photographs)
    mine = out / "keypoints" / "note#1.txt"
    mine.write_text("kept")
    write_matches_text(out, [some_views("two.jpg", 7, 2)], photographs[1:])
    left = sorted(path.name for path in out.rglob("*") if path.is_file() or path.is_symlink())
    views = ["two.jpg#close", "two.jpg#close.txt", "two.jpg#open", "two.jpg#open.txt"]
    assert left == sorted(["matches.txt", "note#1.txt", *views])
    assert all(path.read_bytes() for path in photographs)


def test_pycolmap_imports_the_pictures_under_the_views_names(tmp_path: Path) -> None:
    import cv2
    import pycolmap

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


def test_views_without_a_geometry_have_an_empty_block() -> None:
    given = some_views()
    none = replace(given, geometry=replace(given.geometry, F=None, inlier_mask=np.zeros(4, bool)))
    assert list(imported_matches(matches_text(none))) == [("a.jpg#open", "a.jpg#close", [])]


@pytest.mark.parametrize("name", ["my photo.jpg", "tab\there.jpg", "line\nbreak.jpg"])
def test_a_blank_in_a_name_is_refused_before_anything_is_written(tmp_path: Path, name: str) -> None:
    with pytest.raises(OutputError, match="blank"):
        write_matches_text(tmp_path / "out", [some_views(), some_views(name)], [tmp_path, tmp_path])
    assert not (tmp_path / "out").exists()


def test_a_folder_that_takes_no_files_is_named(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(OutputError, match="out: cannot be written"):
        write_matches_text(tmp_path / "out", [some_views()], [tmp_path / "a.jpg"])


def test_matches_of_others_are_refused_and_stay(tmp_path: Path) -> None:
    (tmp_path / "matches.txt").write_text("a.jpg b.jpg\n0 0\n\n")
    with pytest.raises(OutputError, match=r"matches\.txt: holds more than views"):
        write_matches_text(tmp_path, [some_views()], [tmp_path / "a.jpg"])
    assert [path.name for path in tmp_path.iterdir()] == ["matches.txt"]


def test_a_pipe_in_place_of_matches_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "matches.txt")
    with pytest.raises(OutputError, match=r"matches\.txt: cannot be read \(is no regular file\)"):
        write_matches_text(tmp_path, [some_views()], [tmp_path / "a.jpg"])
