"""COLMAP's models as anybody may have written them: whole ones are read, odd ones are refused in one line."""

import json
import shutil
import sqlite3
import struct
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view.colmap.models import (
    DATABASE,
    PICTURES,
    PROJECT_FILE,
    RECORDS,
    find_model,
    noted,
    read_ids,
    read_model,
    refuse_other_model,
    write_model,
)
from blur2view.errors import DatabaseError, OutputError
from blur2view.output import NOTES
from tests.support.walks import Walk

WALK = Walk(
    names=("a.jpg", "b.jpg", "a.jpg#open"),
    size=(100, 80),
    focal=99.0,
    turn=np.zeros(3),
    move=np.array([0.1, 0, 0]),
)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """Return the folder of a model of two photographs and a view, in binary files."""
    points = np.random.default_rng(0).uniform([-1, -1, 4], [1, 1, 6], (9, 3))
    WALK.write(points, tmp_path / "walk.db", {tmp_path / "model": range(3)})
    return tmp_path / "model"


def test_a_whole_model_is_read_in_both_forms(model: Path) -> None:
    assert find_model(model) == model and len(read_model(model).images) == 3
    (model / "text").mkdir()
    pycolmap.Reconstruction(model).write_text(model / "text")
    assert len(read_model(model / "text").images) == 3


@pytest.mark.parametrize(
    ("name", "cut"),
    [("points3D.bin", 0), ("points3D.bin", 100), ("frames.bin", 100), ("images.bin", 9), ("cameras.bin", 1)],
)
def test_a_file_that_ends_early_is_refused_before_pycolmap_takes_memory(
    model: Path, name: str, cut: int
) -> None:
    data = (model / name).read_bytes()
    (model / name).write_bytes(data[: len(data) - cut] if cut else b"")
    with pytest.raises(DatabaseError, match=r"model: its model is damaged \(.*\); let COLMAP write it again"):
        read_model(model)


def test_points_in_text_that_were_cut_between_lines_are_refused(model: Path) -> None:
    (model / "text").mkdir()
    pycolmap.Reconstruction(model).write_text(model / "text")
    points = model / "text" / "points3D.txt"
    lines = points.read_text().splitlines(keepends=True)
    points.write_text("".join(lines[:-4]))
    with pytest.raises(DatabaseError, match=r"damaged \(points3D\.txt states 9 points and has 5\)"):
        read_model(model / "text")
    points.write_text("".join(line for line in lines[:-4] if line[0] != "#"))  # of a program without a head
    assert len(read_model(model / "text").points3D) == 5


@pytest.mark.parametrize(
    ("name", "at", "written"),
    [
        ("images.bin", 8 + 64, b"\xff"),  # of a name
        ("frames.bin", 2, b"\x80"),  # of their number
        ("frames.bin", 8 + 8 + 32, struct.pack("<d", np.nan)),
        ("cameras.bin", 8 + 24, struct.pack("<d", np.inf)),
        ("points3D.bin", 8 + 8, struct.pack("<d", 1e300)),
    ],
)
def test_a_model_that_contradicts_itself_is_one_line(model: Path, name: str, at: int, written: bytes) -> None:
    data = bytearray((model / name).read_bytes())
    data[at : at + len(written)] = written
    (model / name).write_bytes(data)
    with pytest.raises(DatabaseError, match="its model is damaged"):
        read_model(model)


def test_a_camera_without_rays_in_a_plane_is_refused(model: Path, tmp_path: Path) -> None:
    panorama = tmp_path / "panorama"
    panorama.mkdir()
    pycolmap.Reconstruction(model).write_text(panorama)
    (panorama / "cameras.txt").write_text("1 EQUIRECTANGULAR 100 80 100 80\n")
    with pytest.raises(DatabaseError, match="panorama: its camera EQUIRECTANGULAR has no rays in a plane"):
        read_model(panorama)


def test_a_model_of_an_earlier_call_is_replaced_and_no_other(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for _ in range(2):
        refuse_other_model(out, model)
        write_model(read_model(model), out, tmp_path, tmp_path / "walk.db")
    assert [noted(out, key) for key in (PICTURES, DATABASE)] == [tmp_path, tmp_path / "walk.db"]
    with pytest.raises(OutputError, match=r"rigs\.bin: was not written by an earlier call"):
        refuse_other_model(model, out)
    with pytest.raises(OutputError, match="out: would replace the model of this call"):
        refuse_other_model(tmp_path / "model" / ".." / "out", out)


def test_a_model_that_was_refined_since_stays(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_model(read_model(model), out, tmp_path)
    refined = pycolmap.Reconstruction(out)
    refined.points3D[1].xyz = np.array([0.1, 0.2, 5])
    refined.write_text(out)
    with pytest.raises(OutputError, match=r"rigs\.txt: has changed since"):  # COLMAP would read ours
        refuse_other_model(out, model)
    for path in out.glob("*.txt"):
        path.unlink()
    refuse_other_model(out, model)
    refined.write_binary(out)
    with pytest.raises(OutputError, match=r"points3D\.bin: has changed since .* move it away, or name"):
        refuse_other_model(out, model)


def test_a_damaged_model_beside_a_whole_one_is_passed_over(model: Path, tmp_path: Path) -> None:
    models = tmp_path / "models"
    for name in "01":
        shutil.copytree(model, models / name)
    (models / "0" / "images.bin").write_bytes(b"damaged")
    named = list[DatabaseError]()
    assert find_model(models, named.append) == models / "1"
    assert [*map(str, named)] == [
        f"{models / '0'}: its model is damaged (images.bin ends within a record); "
        "let COLMAP write it again; it is passed over"
    ]
    (models / "1" / "images.bin").write_bytes(b"damaged")
    with pytest.raises(DatabaseError, match="0: its model is damaged"):
        read_model(find_model(models))


def test_ids_are_numbers_that_colmap_can_hold(model: Path, tmp_path: Path) -> None:
    walk = tmp_path / "walk.db"
    assert read_ids(walk).frames == {"a.jpg": 1, "b.jpg": 2, "a.jpg#open": 3}
    with closing(sqlite3.connect(walk)) as database:
        database.execute("UPDATE frame_data SET frame_id = 4294967307 WHERE data_id = 1")
        database.commit()
    assert read_ids(walk).frames == {"b.jpg": 2, "a.jpg#open": 3}


KILLED = """
import os, sys
from pathlib import Path
from blur2view.colmap import models
models.file_digest = lambda path: os.kill(os.getpid(), 9)
models.write_model(models.read_model(Path(sys.argv[1])), Path(sys.argv[2]), Path("frames"))
"""


def test_what_a_killed_call_left_goes_with_the_next(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    assert subprocess.run([sys.executable, "-c", KILLED, model, out]).returncode == -9
    assert len([*out.iterdir()]) == 1
    write_model(read_model(model), out, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"deep", "model", "walk.db"}
    assert {path.name for path in out.iterdir()} == {*RECORDS, PROJECT_FILE, NOTES}


@pytest.mark.parametrize(
    "edit", ["width = 0", "height = 0", "params = [-99, 50, 40]", "params = [0, 50, 40]"]
)
def test_a_camera_without_size_or_focal_length_is_refused(model: Path, edit: str) -> None:
    read, (name, value) = pycolmap.Reconstruction(model), edit.split(" = ")
    setattr(read.cameras[1], name, json.loads(value))
    read.write(model)
    with pytest.raises(DatabaseError, match="camera 1 has no positive size and focal length"):
        read_model(model)


FULL = """
import resource, signal, sys
from pathlib import Path
from blur2view.colmap.models import read_model, write_model
model = read_model(Path(sys.argv[1]))
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
for most in (0, 200, 500, 800):
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
    try:
        write_model(model, Path(sys.argv[2]), Path("frames"))
    except Exception as error:
        print(type(error).__name__, error)
"""


def test_on_a_full_disk_the_earlier_model_stays(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_model(read_model(model), out, tmp_path)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    done = subprocess.run([sys.executable, "-c", FULL, model, out], capture_output=True, text=True)
    lines = done.stdout.splitlines()
    assert len(lines) == 4, done.stderr
    assert all(line.startswith(f"OutputError {out}: ") and "free some space" in line for line in lines), lines
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
