"""COLMAP's models as anybody may have written them: whole ones are read, odd ones are refused in one line."""

import os
import struct
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view.colmap.models import find_model, read_model
from blur2view.errors import DatabaseError
from tests.support.walks import Walk

WALK = Walk(
    names=("a.jpg", "b.jpg", "a.jpg#open"),
    size=(100, 80),
    focal=99.0,
    turn=np.zeros(3),
    move=np.array([0.1, 0, 0]),
    rig=True,
)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """Return the folder of a model of two photographs and a view, in binary files."""
    points = np.random.default_rng(0).uniform([-1, -1, 4], [1, 1, 6], (9, 3))
    WALK.write(points, tmp_path / "walk.db", {tmp_path / "model": range(3)})
    return tmp_path / "model"


def test_a_whole_model_is_read_in_both_forms(model: Path) -> None:
    assert find_model(model).registered == 2
    (model / "text").mkdir()
    pycolmap.Reconstruction(model).write_text(model / "text")
    assert find_model(model / "text").registered == 2


@pytest.mark.parametrize(("name", "at"), [("points3D.bin", 0), ("images.bin", 8 + 64 + len("a.jpg") + 1)])
def test_a_count_that_no_file_holds_is_refused_before_memory_is_taken(
    model: Path, monkeypatch: pytest.MonkeyPatch, name: str, at: int
) -> None:
    data = bytearray((model / name).read_bytes())
    data[at : at + 8] = b"\0\0\0\x10" * 2
    (model / name).write_bytes(data)
    monkeypatch.setattr(pycolmap, "Reconstruction", lambda folder: pytest.fail("read"))
    with pytest.raises(DatabaseError, match="holds no model that can be read"):
        find_model(model)


@pytest.mark.parametrize("name", ["images.bin", "other.txt"])
def test_what_waits_for_ever_is_refused(model: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    (model / name).unlink(missing_ok=True)
    os.mkfifo(model / name)
    monkeypatch.setattr(pycolmap, "Reconstruction", lambda folder: pytest.fail("read"))
    with pytest.raises(DatabaseError, match="holds no model that can be read"):
        find_model(model)


@pytest.mark.parametrize(
    ("name", "at", "written", "why"),
    [
        ("images.bin", 8 + 64, b"\xff", "the name of image 1 is no UTF-8"),
        ("frames.bin", 8 + 8 + 32, struct.pack("<d", np.nan), "image a.jpg has a pose that is nowhere"),
        ("cameras.bin", 8 + 24, struct.pack("<d", np.inf), "camera 1 has parameters that none has"),
        ("points3D.bin", 8 + 8, struct.pack("<d", 1e300), "has points that are nowhere"),
    ],
)
def test_an_image_that_contradicts_itself_is_refused_in_one_line(
    model: Path, name: str, at: int, written: bytes, why: str
) -> None:
    data = bytearray((model / name).read_bytes())
    data[at : at + len(written)] = written
    (model / name).write_bytes(data)
    with pytest.raises(DatabaseError, match=why):
        read_model(model)
