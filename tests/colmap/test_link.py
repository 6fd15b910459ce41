"""Views added to a user's project: what is written, that nothing of the user's changes, and every failure."""

import sqlite3
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view.colmap.database import ProjectImage, plan_links, write_links
from blur2view.colmap.project import (
    MAX_IMAGES,
    camera_of_database,
    image_names,
    open_for_writing,
    smear_lengths,
)
from blur2view.errors import CameraError, DatabaseError
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.epipolar import unit_norm
from tests.support.colmap_projects import (
    ProjectOptions,
    check_database,
    make_project,
    random_views,
    run_sql,
    user_rows,
)
from tools.robustness.odd_inputs import mutated

FEATURES = 40
KINDS = [ProjectOptions(), ProjectOptions(wal=False), ProjectOptions(old=True), ProjectOptions(frames=False)]


@pytest.fixture
def path(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """Return the database of a project, with a write-ahead log unless the test asks for another."""
    make_project(tmp_path / "project.db", getattr(request, "param", None))
    return tmp_path / "project.db"


def link(path: Path, *names: str, backup: bool = False) -> Path | None:
    plans = plan_links(path, [Path(name) for name in names])
    return write_links(path, [views_of(plan) for plan in plans], backup=backup)


def only_plan(path: Path, name: str = "a_001.jpg") -> ProjectImage | DatabaseError:
    (plan,) = plan_links(path, [Path(name)])
    return plan


def views_of(plan: ProjectImage | DatabaseError, seed: int = 0) -> ExposureViews:
    assert isinstance(plan, ProjectImage)
    rng = np.random.default_rng(seed)
    views = random_views(plan.name, FEATURES, rng)
    usable = views.geometry.inlier_mask | (rng.random(FEATURES) < 0.5)
    return replace(views, usable=usable)


@pytest.mark.parametrize("kind", KINDS, ids=["wal", "journal", "old", "no frames"])
def test_user_rows_stay_and_pycolmap_reads_the_views(tmp_path: Path, kind: ProjectOptions) -> None:
    path = tmp_path / "project.db"
    make_project(path, kind)
    before, found = user_rows(path), check_database(path)
    assert found == []
    link(path, "a_000.jpg", "photos/a_002.jpg")
    assert user_rows(path) == before
    assert check_database(path) == []
    with pycolmap.Database.open(path) as database:
        images = {image.name: image.image_id for image in database.read_all_images()}
        assert len(images) == 7
        ids = [images[name] for name in ("a_000.jpg", "a_000.jpg#open", "a_000.jpg#close")]
        first, last = (database.read_keypoints(image_id) for image_id in ids[1:])
        views = views_of(only_plan(path, "a_000.jpg"))
        np.testing.assert_allclose(first, views.points_open + 0.5, atol=1e-4)
        np.testing.assert_allclose(last, views.points_close + 0.5, atol=1e-4)
        assert views.usable is not None
        usable, used = np.flatnonzero(views.usable), np.flatnonzero(views.geometry.inlier_mask)
        for one, other in ((0, 1), (0, 2), (1, 2)):
            matches = database.read_matches(ids[one], ids[other])
            geometry = database.read_two_view_geometry(ids[one], ids[other])
            np.testing.assert_array_equal(matches, np.stack([usable] * 2, axis=1))
            np.testing.assert_array_equal(geometry.inlier_matches, np.stack([used] * 2, axis=1))
            assert geometry.F is not None and geometry.config == 3  # else calibrate_view_graph throws
        assert database.num_rigs() == (1 if kind.frames and not kind.old else 0)
    with pycolmap.Database.open(path) as database:  # what the mapper loads: throws where a frame is missing
        cache = pycolmap.DatabaseCache.create(database, pycolmap.DatabaseCacheOptions())
    assert {"a_000.jpg#open", "a_002.jpg#close"} <= {image.name for image in cache.images.values()}


def test_half_geometries_lead_from_the_photograph(path: Path) -> None:
    views = views_of(only_plan(path))
    F = np.cross(np.eye(3), np.random.default_rng(0).normal(size=3))  # a translation: half has the same F
    views = replace(views, geometry=replace(views.geometry, F=F))
    write_links(path, [views], backup=False)
    with pycolmap.Database.open(path) as database:
        geometries = [database.read_two_view_geometry(*pair).F for pair in ((2, 4), (2, 5), (4, 5))]
    to_open, to_close, whole = (unit_norm(np.asarray(found, float)) for found in geometries)
    np.testing.assert_allclose(to_close, whole, atol=1e-9)
    np.testing.assert_allclose(to_open, -whole, atol=1e-9)


def names_of(path: Path) -> dict[str, int]:
    with open_for_writing(path) as database:
        return image_names(database)


def test_linking_again_writes_views_anew_under_their_ids_also_beside_those_of_an_earlier_version(
    path: Path,
) -> None:
    before = user_rows(path)
    link(path, "a_000.jpg", "a_001.jpg")
    ids = names_of(path)
    run_sql(path, "ALTER TABLE blur2view_views DROP COLUMN smear_px")  # as of 0.2.0
    views = views_of(only_plan(path), seed=1)
    write_links(path, [replace(views, smear_px=7.5)], backup=False)
    assert smear_lengths(path) == {"a_001.jpg": 7.5} and names_of(path) == ids and user_rows(path) == before
    assert check_database(path) == []
    with pycolmap.Database.open(path) as database:
        keypoints = database.read_keypoints(ids["a_001.jpg#open"])
    np.testing.assert_allclose(keypoints, views.points_open + 0.5, atol=1e-4)


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
    "params missing": "UPDATE cameras SET params = NULL",
    "endless view": "ALTER TABLE cameras RENAME TO c; CREATE VIEW cameras AS WITH RECURSIVE n(k) AS "
    "(VALUES(1) UNION ALL SELECT k + 1 FROM n) SELECT k AS camera_id, c.* FROM n, c",
    "trigger": "CREATE TRIGGER t AFTER INSERT ON images BEGIN DELETE FROM keypoints; END",
    "frames of 64 bits": "UPDATE sqlite_sequence SET seq = 4294967300 WHERE name = 'frames'",
    "images of 64 bits": "UPDATE sqlite_sequence SET seq = 4294967300 WHERE name = 'images'",
    "all empty": "DELETE FROM images; DELETE FROM cameras; DELETE FROM keypoints",
}


@pytest.mark.parametrize(
    ("fault", "line"),
    [
        ("params missing", "camera 1 is damaged, because it has no parameters; let COLMAP write it again"),
        ("endless view", "its cameras are an SQL view, but COLMAP's are a table"),
        ("trigger", "has the trigger t, .* remove it"),
        ("frames of 64 bits", "its frames have numbers up to 4294967300, which is COLMAP's limit"),
    ],
)
def test_a_project_that_colmap_could_not_read_is_refused(path: Path, fault: str, line: str) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.executescript("PRAGMA foreign_keys = OFF;" + SQL_FAULTS[fault])
    with pytest.raises(DatabaseError, match=line):
        plan = only_plan(path)
        if isinstance(plan, DatabaseError):
            raise plan
        write_links(path, [views_of(plan)], backup=False)
    if fault == "endless view":
        with pytest.raises(CameraError, match=line):
            camera_of_database(path)


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
    links = [views_of(only_plan(path, name)) for name in ("a_000.jpg", "a_001.jpg")]
    run_sql(path, edit)
    before, names = user_rows(path), names_of(path)
    with pytest.raises(DatabaseError, match=r"a_001\.jpg has changed while blur2view worked"):
        write_links(path, links, backup=False)
    assert user_rows(path) == before and names_of(path) == names


@pytest.mark.parametrize("path", [ProjectOptions(wal=False)], indirect=True, ids=["journal"])
def test_a_locked_database_is_refused_and_linking_locks(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("blur2view.colmap.project.LOCK_TIMEOUT_S", 0.05)
    planned = views_of(only_plan(path))
    with closing(sqlite3.connect(path, timeout=0, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(DatabaseError, match="close the programs that use it"):
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
            write_links(path, [views], backup=False)
            assert user_rows(path) == rows
            return
    except DatabaseError as error:
        plan = error
    assert isinstance(plan, DatabaseError)
    assert str(path) in str(plan) and "\n" not in str(plan)
    assert path.read_bytes() == before
