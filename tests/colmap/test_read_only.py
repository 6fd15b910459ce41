"""What reads a user's COLMAP database leaves the file and its folder as they were, and says what is wrong."""

import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from blur2view.colmap.database import ProjectImage, plan_links
from blur2view.colmap.placement import place_views
from blur2view.colmap.project import camera_of_database, open_read_only
from blur2view.errors import Blur2ViewError
from tests.colmap.test_placement import FRAMES, NAMES, project
from tests.support.colmap_projects import run_sql


def linked_before(path: Path) -> bool:
    return all(isinstance(plan, ProjectImage) and plan.linked for plan in plan_links(path, [Path(NAMES[0])]))


READERS: dict[str, Callable[[Path], bool]] = {  # each tells whether it has found what is there
    "camera": lambda path: camera_of_database(path, None, f"/data/{NAMES[0]}").known,
    "plans": linked_before,
    "placed": lambda path: len(place_views(path, path.parent.parent / "model").placed) == FRAMES,
}


@pytest.fixture(scope="module")
def linked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder that holds "db", a linked project's database with a write-ahead log, and "model"."""
    folder = tmp_path_factory.mktemp("linked")
    database, model = project(folder)
    (folder / "db").mkdir()
    assert run_sql(database, "PRAGMA journal_mode = WAL") == [("wal",)]
    database.rename(folder / "db" / "walk.db")
    return folder


def contents(path: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in path.parent.iterdir()}


@pytest.fixture
def path(linked: Path, tmp_path: Path) -> Path:
    """Return the database of a copy of the linked project."""
    shutil.copytree(linked / "model", tmp_path / "model")
    shutil.copytree(linked / "db", tmp_path / "db")
    return tmp_path / "db" / "walk.db"


def rollback_journal(path: Path) -> None:
    assert run_sql(path, "PRAGMA journal_mode = DELETE") == [("delete",)]


def killed(path: Path, sql: str) -> None:
    """Let another process write and die without a word."""
    program = (
        "import os, sqlite3, sys; database = sqlite3.connect(sys.argv[1], isolation_level=None);"
        f"[database.execute(line) for line in {sql!r}.split(';')]; os.kill(os.getpid(), 9)"
    )
    assert subprocess.run([sys.executable, "-c", program, path]).returncode == -9


def killed_with_log(path: Path) -> None:
    killed(path, "CREATE TABLE more (x); INSERT INTO more VALUES (7)")
    assert path.with_name("walk.db-wal").stat().st_size > 0


@pytest.mark.parametrize("state", [rollback_journal, killed_with_log])
def test_every_reader_leaves_file_and_folder_as_they_were(path: Path, state: Callable[[Path], None]) -> None:
    state(path)
    before, time = contents(path), path.stat().st_mtime_ns
    for name, reads in READERS.items():
        assert reads(path), name
        assert contents(path) == before, name
    assert path.stat().st_mtime_ns == time
    with open_read_only(path) as database:
        more = database.execute("SELECT 1 FROM sqlite_master WHERE name = 'more'").fetchone()
    assert (more is not None) == (state is killed_with_log)


def locked(path: Path) -> sqlite3.Connection:
    rollback_journal(path)
    other = sqlite3.connect(path, isolation_level=None)
    other.executescript("BEGIN EXCLUSIVE; CREATE TABLE more (x)")
    return other


def killed_midway(path: Path) -> None:
    rollback_journal(path)
    killed(path, "PRAGMA cache_size = 1; BEGIN; DELETE FROM keypoints; CREATE TABLE more (x)")


def foreign(path: Path) -> None:
    path.write_text("a list of photographs")


def newer(path: Path) -> None:
    run_sql(path, "PRAGMA user_version = 9000000")


FAULTS: dict[Callable[[Path], object], str] = {
    locked: "close the programs that use it",
    killed_midway: "if a program that used it was killed, open it once with COLMAP",
    foreign: "is not a COLMAP database .*; name the one that COLMAP's --database_path names",
    newer: "newer COLMAP .*; update blur2view",
    Path.unlink: "no such database; check the path",
}


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_what_is_wrong_is_one_clear_line(
    path: Path, monkeypatch: pytest.MonkeyPatch, fault: Callable[[Path], object]
) -> None:
    monkeypatch.setattr("blur2view.colmap.project.LOCK_TIMEOUT_S", 0.05)
    other = fault(path)
    before = contents(path)
    for name, reads in READERS.items():
        if fault is newer and name != "plans":
            assert reads(path), name  # as long as the columns are there
            continue
        with pytest.raises(Blur2ViewError, match=FAULTS[fault]) as caught:
            reads(path)
        assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    if isinstance(other, sqlite3.Connection):
        other.close()
    assert contents(path) == before or fault is locked
