"""Copies of dull photographs: which are stretched, what stays, what is never replaced."""

from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from blur2view.colmap import contrast
from blur2view.colmap.contrast import write_stretched
from blur2view.errors import ImageError, OutputError
from blur2view.images.image import Picture

NOISE = np.random.default_rng(0).uniform(0, 255, (120, 160))


def write(folder: Path, name: str, values: np.ndarray) -> bytes:
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    exif = Image.Exif()
    exif[ExifTags.Base.Make] = "Maker"
    Image.fromarray(values.astype(np.uint8)).save(folder / name, quality=98, exif=exif)
    return (folder / name).read_bytes()


def test_dull_photographs_are_stretched_and_others_are_as_they_were(tmp_path: Path) -> None:
    frames, copies = tmp_path / "frames", tmp_path / "copies"
    bright = write(frames, "a.jpg", NOISE)
    write(frames, "deep/b.jpg", 20 + NOISE / 3)
    assert write_stretched(frames, copies) == ("deep/b.jpg",)
    assert (copies / "a.jpg").read_bytes() == bright
    with Image.open(copies / "deep" / "b.jpg") as copy:
        assert copy.size == (160, 120) and copy.getexif()[ExifTags.Base.Make] == "Maker"
        assert np.asarray(copy).std() > 1.5 * (NOISE / 3).std()


def test_a_file_that_is_there_is_not_replaced(tmp_path: Path) -> None:
    frames, copies = tmp_path / "frames", tmp_path / "copies"
    write(frames, "a.png", NOISE / 3)
    mine = write(copies, "a.png", NOISE)
    with pytest.raises(OutputError, match=r"a.png: already exists; name another folder"):
        write_stretched(frames, copies)
    assert (copies / "a.png").read_bytes() == mine


def test_a_dull_raw_photograph_is_named_and_not_the_folder_of_copies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = tmp_path / "frames"
    write(frames, "a.png", NOISE / 3)
    (frames / "a.png").rename(frames / "a.dng")
    picture = Picture(pixels=np.zeros((120, 160, 3), np.uint16))
    monkeypatch.setattr(contrast, "read_picture", lambda path, **options: picture)
    with pytest.raises(
        ImageError,
        match=r"frames/a\.dng: has little contrast, and its copy cannot be a \.dng file; develop it",
    ):
        write_stretched(frames, tmp_path / "copies")
