"""What is COLMAP's and what is not, and that no row of the user's is lost where a check missed something."""

import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from blur2view.colmap import connection
from blur2view.colmap.cameras import camera_of_database
from blur2view.colmap.link import plan_links
from blur2view.errors import CameraError, DatabaseError
from tests.colmap.test_link import link
from tests.support.colmap_projects import ProjectOptions, make_project
from tests.support.malformed_projects import SQL_FAULTS

# Refused before any work; other faults end the transaction.
NOT_COLMAPS = ["view of our name", "column gone", "own table of another", "trigger"]


def faulty(path: Path, fault: str) -> Path:
    make_project(path, ProjectOptions(wal=False))
    with closing(sqlite3.connect(path)) as database:
        database.executescript(fault)
        database.commit()
    return path


@pytest.mark.parametrize("kind", NOT_COLMAPS)
def test_what_no_colmap_makes_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = faulty(tmp_path / "project.db", SQL_FAULTS[kind])
    before = path.read_bytes()
    with pytest.raises(DatabaseError, match=rf"^{path}: [^\n]*$"):
        plan_links(path, [Path("a_001.jpg"), Path("a_002.jpg")])
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["project.db"]


def test_rows_that_a_schema_replaces_are_rolled_back(tmp_path: Path) -> None:
    path = faulty(tmp_path / "project.db", SQL_FAULTS["replacing keypoints"])
    before = path.read_bytes()
    with pytest.raises(DatabaseError, match="would lose rows of yours"):
        link(path, "a_001.jpg", backup=True)
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["project.db"]


def test_a_camera_without_a_rig_is_told_and_gets_none(tmp_path: Path) -> None:
    path = faulty(tmp_path / "project.db", "PRAGMA foreign_keys = OFF; DELETE FROM rigs")
    (plan,) = plan_links(path, [Path("a_001.jpg")])
    assert isinstance(plan, DatabaseError) and "camera 1 of image a_001.jpg has no rig" in str(plan)


@pytest.mark.parametrize("suffix", ["-journal", "-wal", "-shm"])
def test_a_pipe_beside_a_database_is_not_waited_for(tmp_path: Path, suffix: str) -> None:
    path = faulty(tmp_path / "project.db", "")
    os.mkfifo(f"{path}{suffix}")
    for opened in (connection.open_read_only, connection.open_for_writing):
        with pytest.raises(DatabaseError, match=rf"db{suffix} beside it is no regular file"), opened(path):
            pass


@pytest.mark.parametrize(
    "values",
    ["width = 9e999", "height = -9e999", "width = 'wide'", "model = x'00'", "params = NULL", "params = 'f'",
     "params = zeroblob(800000)", "width = 1 << 62"],
)  # fmt: skip
def test_a_camera_of_odd_values_is_one_line(tmp_path: Path, values: str) -> None:
    path = faulty(tmp_path / "project.db", f"UPDATE cameras SET {values}")
    with pytest.raises(CameraError, match="camera") as caught:
        camera_of_database(path, 1)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400
