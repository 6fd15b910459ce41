"""Linking that fails, is killed or must wait: the project is as before, or wholly linked."""

import sqlite3
from contextlib import closing, suppress
from pathlib import Path

import numpy as np
import pytest

from blur2view.colmap.database import ProjectImage, write_links
from blur2view.colmap.project import MAX_IMAGES, open_for_writing
from blur2view.errors import DatabaseError
from tests.colmap.test_link import ROLLBACK, link, link_of, names_of, only_plan
from tests.support.colmap_projects import ProjectOptions, make_project, random_views, run_sql, user_rows
from tools.evaluation.fuzz import mutated

SQL_FAULTS = {
    "newer": "PRAGMA user_version = 4030000",
    "no images": "DROP TABLE images",
    "column renamed": "ALTER TABLE keypoints RENAME COLUMN data TO blob",
    "view for a table": "DROP TABLE matches; CREATE VIEW matches AS SELECT image_id AS pair_id, 0 AS rows, "
    "2 AS cols, NULL AS data FROM images",
    "own table of another": "CREATE TABLE blur2view_views (image_id INTEGER, note TEXT)",
    "view of our name": "INSERT INTO images VALUES (9, 'a_001.jpg#open', 1)",
    "rows too many": "UPDATE keypoints SET rows = 1000",
    "keypoints not finite": "UPDATE keypoints SET data = zeroblob(0) || x'0000C07F' || substr(data, 5)",
    "camera unknown": "UPDATE cameras SET model = 99",
    "name a blob": "UPDATE images SET name = x'00FF' WHERE image_id = 3",
    "last id": f"INSERT INTO images VALUES ({MAX_IMAGES - 1}, 'last.jpg', 1)",
    "counter at its end": "UPDATE sqlite_sequence SET seq = 9223372036854775807",
    "all empty": "DELETE FROM images; DELETE FROM cameras; DELETE FROM keypoints",
}


def test_a_backup_is_what_was_there(path: Path) -> None:
    with closing(sqlite3.connect(path)) as database:
        before = list(database.iterdump())
    first, second = link(path, "a_000.jpg", backup=True), link(path, "a_001.jpg", backup=True)
    assert first is not None and first.name.startswith("project.db.") and first.suffix == ".bak"
    assert second not in (None, first)
    with closing(sqlite3.connect(first)) as database:
        assert list(database.iterdump()) == before


@pytest.mark.parametrize(
    "edit",
    [
        "UPDATE keypoints SET rows = 20, data = substr(data, 1, 480) WHERE image_id = 2",
        "DELETE FROM images WHERE image_id = 2",
    ],
)
def test_an_image_that_changed_since_the_plan_stops_the_write(path: Path, edit: str) -> None:
    links = [link_of(only_plan(path, name)) for name in ("a_000.jpg", "a_001.jpg")]
    run_sql(path, edit)
    before, names = user_rows(path), names_of(path)
    with pytest.raises(DatabaseError, match=r"a_001\.jpg has changed meanwhile"):
        write_links(path, links, backup=False)
    assert user_rows(path) == before and names_of(path) == names


@ROLLBACK
def test_a_locked_database_is_refused_and_linking_locks(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("blur2view.colmap.project.LOCK_TIMEOUT_S", 0.05)
    planned = link_of(only_plan(path))
    with closing(sqlite3.connect(path, timeout=0, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(DatabaseError, match="close programs that use it"):
            write_links(path, [planned], backup=False)
        other.execute("ROLLBACK")
        locked = pytest.raises(sqlite3.OperationalError, match="locked")
        with open_for_writing(path), locked:  # before it reads
            other.execute("BEGIN IMMEDIATE")
    write_links(path, [planned], backup=False)


@pytest.mark.parametrize("number", [*range(len(SQL_FAULTS)), *range(100, 104)])
def test_malformed_projects_are_refused_or_left_as_they_were(tmp_path: Path, number: int) -> None:
    path = tmp_path / "project.db"
    rng = np.random.default_rng(number)
    make_project(path, ProjectOptions(old=number % 5 == 4, wal=False), seed=number)
    if number < len(SQL_FAULTS):
        with closing(sqlite3.connect(path)) as database, suppress(sqlite3.OperationalError):
            database.executescript(list(SQL_FAULTS.values())[number])  # an old project lacks some tables
            database.commit()
    else:
        path.write_bytes(mutated(path.read_bytes(), rng))
    before = path.read_bytes()
    try:
        rows = user_rows(path)
    except (sqlite3.Error, UnicodeDecodeError):
        rows = {}
    path.write_bytes(before)
    try:
        plan = only_plan(path)
        if isinstance(plan, ProjectImage):
            views = random_views(plan.name, len(plan.keypoints), np.random.default_rng(0))
            write_links(path, [(plan, views)], backup=False)
            assert user_rows(path) == rows
            return
    except DatabaseError as error:
        plan = error
    assert isinstance(plan, DatabaseError)
    assert str(path) in str(plan) and "\n" not in str(plan)
    assert path.read_bytes() == before
