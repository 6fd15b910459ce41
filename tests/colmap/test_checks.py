"""Odd rows of a user's database, and pipes beside it."""

import os
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from blur2view.colmap import connection
from blur2view.colmap.cameras import camera_of_database
from blur2view.errors import Blur2ViewError, CameraError, DatabaseError
from tests.support.colmap_projects import ProjectOptions, make_project


def faulty(path: Path, fault: str) -> Path:
    make_project(path, ProjectOptions(wal=False))
    with closing(sqlite3.connect(path)) as database:
        database.executescript(fault)
        database.commit()
    return path


@pytest.mark.parametrize("suffix", ["-journal", "-wal", "-shm"])
def test_a_pipe_beside_a_database_is_not_waited_for(tmp_path: Path, suffix: str) -> None:
    path = faulty(tmp_path / "project.db", "")
    os.mkfifo(f"{path}{suffix}")
    for opened in (connection.open_read_only, connection.open_for_writing):
        with pytest.raises(DatabaseError, match=rf"db{suffix} beside it is no regular file"), opened(path):
            pass


@pytest.mark.parametrize(
    "values",
    ["width = 9e999", "width = 'wide'", "model = x'00'", "params = NULL", "params = zeroblob(800000)"],
)
def test_a_camera_of_odd_values_is_one_line(tmp_path: Path, values: str) -> None:
    path = faulty(tmp_path / "project.db", f"UPDATE cameras SET {values}")
    with pytest.raises(CameraError, match="camera") as caught:
        camera_of_database(path, 1)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400


def test_many_cameras_are_named_by_a_few(tmp_path: Path) -> None:
    more = " UNION ALL ".join(f"SELECT {number}" for number in range(2, 400))
    copies = f"INSERT INTO cameras SELECT n.*, model, width, height, params, 0 FROM cameras, ({more}) n"
    path = faulty(tmp_path / "project.db", copies)
    for camera, photograph in ((None, "x.jpg"), (999, ""), (None, os.fsdecode(b"\xff.jpg"))):
        with pytest.raises(Blur2ViewError, match=r"1, 2, .*, 10 \.\.\."):
            camera_of_database(path, camera, photograph)
    assert np.isfinite(camera_of_database(path, 2).K).all()
