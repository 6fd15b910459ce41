"""Views added to a project of the user: what is written, and that nothing of the user's changes."""

import sqlite3
import threading
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from blur2view.camera.colmap_geometry import fundamental_to_colmap
from blur2view.colmap.database import write_database
from blur2view.colmap.database_matches import DatabaseMatcher
from blur2view.colmap.link import LinkJob, LinkStep, Step, digest, plan_links, write_links
from blur2view.colmap.project import image_names, longest_suffix, open_project
from blur2view.colmap.rows import add_image, put_keypoints
from blur2view.errors import DatabaseError
from blur2view.exposure.linked_views import KeypointViews
from blur2view.geometry.epipolar import unit_norm
from tools.database_safety.colmap_check import check_database
from tools.database_safety.colmap_projects import ProjectOptions, make_project, user_rows
from tools.database_safety.kill_writes import kill_many, random_views
from tools.database_safety.malformed_projects import SQL_FAULTS, malform

FEATURES = 40
KINDS = [ProjectOptions(), ProjectOptions(wal=False), ProjectOptions(old=True), ProjectOptions(frames=False)]


def job_of(plan: LinkStep | DatabaseError, seed: int = 0) -> LinkJob:
    assert isinstance(plan, LinkStep)
    rng = np.random.default_rng(seed)
    views = random_views(plan.image.name, FEATURES, rng)
    usable = views.geometry.inlier_mask | (rng.random(FEATURES) < 0.5)
    return LinkJob(plan=plan, linked=KeypointViews(views=views, usable=usable))


def link(path: Path, *names: str, replace: bool = False, backup: bool = False, seed: int = 0) -> Path | None:
    plans = plan_links(path, [Path(name) for name in names], replace=replace)
    return write_links(path, [job_of(plan, seed) for plan in plans], backup=backup)


def only_plan(path: Path, name: str = "a_001.jpg", replace: bool = False) -> LinkStep | DatabaseError:
    (plan,) = plan_links(path, [Path(name)], replace=replace)
    return plan


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
        views = job_of(only_plan(path, "a_000.jpg")).linked
        np.testing.assert_allclose(first, views.views.points_open + 0.5, atol=1e-4)
        np.testing.assert_allclose(last, views.views.points_close + 0.5, atol=1e-4)
        usable, used = np.flatnonzero(views.usable), np.flatnonzero(views.views.geometry.inlier_mask)
        for one, other in ((0, 1), (0, 2), (1, 2)):
            matches = database.read_matches(ids[one], ids[other])
            geometry = database.read_two_view_geometry(ids[one], ids[other])
            np.testing.assert_array_equal(matches, np.stack([usable] * 2, axis=1))
            np.testing.assert_array_equal(geometry.inlier_matches, np.stack([used] * 2, axis=1))
            assert geometry.F is not None and geometry.config == 3
        assert database.num_rigs() == (1 if kind.frames and not kind.old else 0)
    with pycolmap.Database.open(path) as database:  # what the mapper loads: throws where a frame is missing
        cache = pycolmap.DatabaseCache.create(database, pycolmap.DatabaseCacheOptions())
    assert {"a_000.jpg#open", "a_002.jpg#close"} <= {image.name for image in cache.images.values()}


def test_a_camera_of_a_rig_keeps_its_rig(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    _run(path, "UPDATE rigs SET ref_sensor_id = 9")  # the camera is the second of a rig
    _run(path, "INSERT INTO cameras SELECT 9, model, width, height, params, 0 FROM cameras")
    _run(path, "INSERT INTO rig_sensors VALUES (1, 1, 0, NULL)")
    before = user_rows(path)
    link(path, "a_000.jpg")
    assert user_rows(path) == before and check_database(path) == []
    with pycolmap.Database.open(path) as database:
        assert database.num_rigs() == 1
        frames = database.read_all_frames()
    assert [frame.rig_id for frame in frames] == [1] * 5


def test_half_geometries_lead_from_the_photograph(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    rng = np.random.default_rng(0)
    plan = only_plan(path)
    job = job_of(plan)
    symmetric, a = np.zeros((3, 3)), rng.normal(size=3)  # a pure translation: half of it has the same F
    F = symmetric + np.cross(np.eye(3), a)
    views = replace(job.linked.views, geometry=replace(job.linked.views.geometry, F=F))
    write_links(path, [LinkJob(plan=job.plan, linked=replace(job.linked, views=views))], backup=False)
    with pycolmap.Database.open(path) as database:
        geometries = [database.read_two_view_geometry(*pair).F for pair in ((2, 4), (2, 5), (4, 5))]
    to_open, to_close, whole = (unit_norm(np.asarray(found, float)) for found in geometries)
    np.testing.assert_allclose(to_close, whole, atol=1e-9)
    np.testing.assert_allclose(to_open, -whole, atol=1e-9)


def test_a_second_run_changes_no_byte(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path, ProjectOptions(wal=False))
    link(path, "a_000.jpg", "a_001.jpg")
    before = path.read_bytes()
    plans = plan_links(path, [Path("a_000.jpg"), Path("a_001.jpg")])
    assert [plan.step for plan in plans if isinstance(plan, LinkStep)] == [Step.KEEP, Step.KEEP]
    assert write_links(path, []) is None
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["project.db"]


def test_replace_rewrites_our_rows_in_place(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    link(path, "a_000.jpg", "a_001.jpg")
    before, names = user_rows(path), _names(path)
    link(path, "a_001.jpg", replace=True, seed=1)
    assert user_rows(path) == before and _names(path) == names
    assert check_database(path) == []
    with pycolmap.Database.open(path) as database:
        kept, new = (database.read_keypoints(names[name]) for name in ("a_000.jpg#open", "a_001.jpg#open"))
    np.testing.assert_allclose(
        kept, job_of(only_plan(path, "a_000.jpg")).linked.views.points_open + 0.5, atol=1e-4
    )
    expected = job_of(only_plan(path, replace=True), seed=1).linked.views.points_open
    np.testing.assert_allclose(new, expected + 0.5, atol=1e-4)


def _names(path: Path) -> dict[str, int]:
    with open_project(path) as database:
        return image_names(database)


def test_new_features_ask_for_replace(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    link(path, "a_001.jpg")
    _run(
        path, "UPDATE keypoints SET data = (SELECT data FROM keypoints WHERE image_id = 1) WHERE image_id = 2"
    )
    plan = only_plan(path)
    assert isinstance(plan, DatabaseError) and "add --replace" in str(plan)
    plan = only_plan(path, replace=True)
    assert isinstance(plan, LinkStep) and plan.step is Step.REPLACE


def test_views_of_a_fresh_database_ask_for_replace_and_say_what_they_are(tmp_path: Path) -> None:
    path = tmp_path / "fresh.db"
    write_database(path, [random_views("a.jpg", FEATURES, np.random.default_rng(0))])
    with open_project(path, write=True) as database:  # as COLMAP's feature extraction does
        image = add_image(database, "a.jpg", 1, with_frame=True)
        put_keypoints(database, image, np.random.default_rng(1).uniform(0, 400, (FEATURES, 2)))
    plan = only_plan(path, "a.jpg")
    assert isinstance(plan, DatabaseError) and "add --replace" in str(plan)
    assert "made without --link" in str(plan) and "changed" not in str(plan)
    link(path, "a.jpg", replace=True)
    assert check_database(path) == []
    after = only_plan(path, "a.jpg")
    assert isinstance(after, LinkStep) and after.step is Step.KEEP


FRAMELESS = "DELETE FROM frame_data WHERE data_id > 3"
GONE = "DELETE FROM images WHERE name = 'a_001.jpg#close'"
ANEW = (
    "CREATE TEMP TABLE kept AS SELECT * FROM keypoints WHERE image_id = 2",
    "DELETE FROM images WHERE image_id = 2",
    "INSERT INTO images(image_id, name, camera_id) VALUES (60, 'a_001.jpg', 1)",
    "INSERT INTO keypoints SELECT 60, rows, cols, data FROM kept",
)


@pytest.mark.parametrize(
    "edits",
    [
        [GONE],
        ANEW,
        [FRAMELESS],
        ["DELETE FROM keypoints WHERE image_id = 4"],
        ["DELETE FROM matches WHERE pair_id > 2147483647 * 4"],
        ["DELETE FROM two_view_geometries WHERE pair_id > 2147483647 * 4"],
    ],
)
def test_a_project_edited_by_hand_can_be_linked_again(tmp_path: Path, edits: Sequence[str]) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    link(path, "a_001.jpg")
    _run(path, *edits)
    before = user_rows(path)
    assert "add --replace" in str(only_plan(path))
    link(path, "a_001.jpg", replace=True)
    assert user_rows(path) == before
    plan = only_plan(path)
    assert isinstance(plan, LinkStep) and plan.step is Step.KEEP
    assert not [line for line in check_database(path) if "#" in line]  # what is said of our views


def test_views_follow_the_camera_of_their_photograph(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    link(path, "a_001.jpg")
    _run(
        path,
        "INSERT INTO cameras SELECT 9, model, width, height, params, 0 FROM cameras",
        "INSERT INTO rigs VALUES (9, 9, 0)",
        "UPDATE images SET camera_id = 9 WHERE image_id = 2",
    )
    link(path, "a_001.jpg", replace=True)
    with closing(sqlite3.connect(path)) as database:
        cameras = database.execute("SELECT camera_id FROM images WHERE name LIKE '%#%'").fetchall()
        sensors = database.execute("SELECT sensor_id FROM frame_data WHERE data_id > 3").fetchall()
        frames = database.execute("SELECT count(*) FROM frames").fetchone()
    assert frames == (5,)
    assert cameras == sensors == [(9,), (9,)]


def test_an_id_that_colmap_never_gives_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path, ProjectOptions(wal=False))
    with closing(sqlite3.connect(path)) as database:  # as a table of other tools, which has no such check
        (sql,) = database.execute("SELECT sql FROM sqlite_master WHERE name = 'images'").fetchone()
        database.executescript(
            "PRAGMA writable_schema = 1;"
            "UPDATE sqlite_master SET sql = replace(sql, '< 2', '< 9') WHERE name = 'images'"
        )
        assert "< 2147483647" in sql
    _run(path, "PRAGMA foreign_keys = OFF", "UPDATE images SET image_id = 1 << 32 WHERE image_id = 2")
    plan = only_plan(path)
    assert isinstance(plan, DatabaseError) and "has the id 4294967296; COLMAP's are below" in str(plan)


def test_a_failed_link_leaves_no_backup(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "project.db"
    make_project(path, ProjectOptions(wal=False))
    _run(path, "UPDATE sqlite_sequence SET seq = 2147483646 WHERE name = 'images'")
    before = path.read_bytes()
    with pytest.raises(DatabaseError, match="its image ids are used up"):
        link(path, "a_001.jpg", backup=True)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["project.db"]


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_matches_of_points_that_are_nowhere_are_left_out(tmp_path: Path, value: float) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    with closing(sqlite3.connect(path)) as database:
        (data,) = database.execute("SELECT data FROM keypoints WHERE image_id = 1").fetchone()
        points = np.frombuffer(data, "<f4").copy()
        points[::12] = value
        database.execute("UPDATE keypoints SET data = ? WHERE image_id = 1", (points.tobytes(),))
        database.commit()
    found = DatabaseMatcher(path, ["a_000.jpg", "a_001.jpg"])(0, 1)
    assert 0 < len(found[0]) == len(found[1]) < FEATURES
    assert np.isfinite(found).all()


@pytest.mark.parametrize("end", ["open", "close"])
def test_a_view_that_was_deleted_is_made_again(tmp_path: Path, end: str) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    link(path, "a_001.jpg")
    before = user_rows(path)
    _run(path, f"DELETE FROM images WHERE name = 'a_001.jpg#{end}'")  # cascades to keypoints, not to pairs
    link(path, "a_001.jpg", replace=True)
    ids = _names(path)
    first, last = ids["a_001.jpg#open"], ids["a_001.jpg#close"]
    assert (first < last) == (end == "close")  # the new one has the larger id
    expected = job_of(only_plan(path, replace=True)).linked.views.geometry.F
    with pycolmap.Database.open(path) as database:
        F = database.read_two_view_geometry(first, last).F
    assert F is not None and expected is not None
    np.testing.assert_allclose(unit_norm(np.asarray(F, float)), fundamental_to_colmap(expected))
    assert {name: rows for name, rows in user_rows(path).items() if name in ("images", "keypoints")} == {
        name: before[name] for name in ("images", "keypoints")
    }


def _run(path: Path, *edits: str) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute("PRAGMA foreign_keys = ON")
        for sql in edits:
            database.execute(sql)


def test_a_backup_is_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    with closing(sqlite3.connect(path)) as database:
        before = list(database.iterdump())
    copies = [link(path, "a_000.jpg", backup=True), link(path, "a_001.jpg", backup=True)]
    assert all(copies) and len(set(copies)) == 2
    assert copies[0] is not None and copies[0].name.startswith("project.db.") and copies[0].suffix == ".bak"
    with closing(sqlite3.connect(copies[0])) as database:
        assert list(database.iterdump()) == before


def test_an_image_that_changed_since_the_plan_stops_the_write(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    jobs = [job_of(only_plan(path, name)) for name in ("a_000.jpg", "a_001.jpg")]
    _run(path, "UPDATE keypoints SET rows = 20, data = substr(data, 1, 480) WHERE image_id = 2")
    before = user_rows(path)
    with pytest.raises(DatabaseError, match=r"a_001\.jpg has changed meanwhile"):
        write_links(path, jobs, backup=False)
    assert user_rows(path) == before and len(_names(path)) == 3


def test_a_failure_midway_undoes_all(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    before = user_rows(path)
    jobs = [job_of(only_plan(path, name)) for name in ("a_000.jpg", "a_001.jpg")]
    _run(path, "INSERT INTO matches VALUES (2147483647 * 2 + 6, 0, 2, NULL)")  # of the second job
    with pytest.raises(DatabaseError, match="UNIQUE"):
        write_links(path, jobs, backup=False)
    assert len(_names(path)) == 3
    assert {k: v for k, v in user_rows(path).items() if k not in ("matches", "blur2view_views")} == {
        k: v for k, v in before.items() if k != "matches"
    }


def test_a_locked_database_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "project.db"
    make_project(path, ProjectOptions(wal=False))
    monkeypatch.setattr("blur2view.colmap.connection.LOCK_TIMEOUT_S", 0.05)
    job = job_of(only_plan(path))
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(DatabaseError, match="another program uses it"):
            only_plan(path)
        with pytest.raises(DatabaseError, match="another program uses it"):
            write_links(path, [job], backup=False)
        other.execute("ROLLBACK")
    write_links(path, [job], backup=False)


def test_a_photograph_is_found_by_the_longest_ending(tmp_path: Path) -> None:
    names = {"a.jpg": 1, "left/a.jpg": 2, "b.jpg": 3}
    assert longest_suffix(names, tmp_path / "left" / "a.jpg") == "left/a.jpg"
    assert longest_suffix(names, tmp_path / "right" / "a.jpg") == "a.jpg"
    assert longest_suffix(names, tmp_path / "c.jpg") is None


def test_unknown_and_repeated_photographs_are_named(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    plans = plan_links(path, [Path("a_000.jpg"), Path("x.jpg"), Path("b/a_000.jpg")])
    assert isinstance(plans[0], LinkStep)
    assert "no image of that name" in str(plans[1]) and "name it once" in str(plans[2])
    with pytest.raises(DatabaseError, match="no such database"):
        plan_links(tmp_path / "none.db", [Path("a_000.jpg")])


@pytest.mark.parametrize("number", [*range(len(SQL_FAULTS)), *range(100, 124)])
def test_malformed_projects_are_refused_or_left_as_they_were(tmp_path: Path, number: int) -> None:
    path = tmp_path / "project.db"
    malform(path, number)
    before = path.read_bytes()
    try:
        rows = user_rows(path)
    except (sqlite3.Error, UnicodeDecodeError):
        rows = {}
    path.write_bytes(before)
    try:
        plan = only_plan(path)
        if isinstance(plan, LinkStep):
            views = random_views(plan.image.name, len(plan.image.keypoints), np.random.default_rng(0))
            usable = np.ones(len(plan.image.keypoints), bool)
            write_links(
                path, [LinkJob(plan=plan, linked=KeypointViews(views=views, usable=usable))], backup=False
            )
            assert user_rows(path) == rows
            return
    except DatabaseError as error:
        plan = error
    assert isinstance(plan, DatabaseError)
    assert str(path) in str(plan) and "\n" not in str(plan)
    assert path.read_bytes() == before


def test_killed_writes_leave_before_or_after() -> None:
    found = kill_many(12, seed=5)
    states = {state.split(",")[0] for counter in found.values() for state in counter}
    assert states <= {"before", "after"}
    assert sum(sum(counter.values()) for counter in found.values()) == 12


def test_linking_holds_the_lock_before_it_reads(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path, ProjectOptions(wal=False))
    other = sqlite3.connect(path, timeout=0, isolation_level=None)
    with (
        closing(other),
        open_project(path, write=True),
        pytest.raises(sqlite3.OperationalError, match="locked"),
    ):
        other.execute("BEGIN IMMEDIATE")


def test_a_writer_that_ends_soon_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path, ProjectOptions(wal=False))
    plan = job_of(only_plan(path))
    with closing(sqlite3.connect(path, isolation_level=None, check_same_thread=False)) as other:
        other.execute("BEGIN IMMEDIATE")
        end = threading.Timer(0.3, other.rollback)
        end.start()
        write_links(path, [plan], backup=False)
        end.join()
    assert len(image_names_of(path)) == 5


def image_names_of(path: Path) -> dict[str, int]:
    with open_project(path) as database:
        return image_names(database)


def test_the_digest_is_of_the_camera_too(tmp_path: Path) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    plan = only_plan(path)
    assert isinstance(plan, LinkStep)
    assert digest(plan.image) != digest(replace(plan.image, camera_id=9))
    assert digest(plan.image) != digest(replace(plan.image, source=b""))


@pytest.mark.parametrize(
    "change",
    ["params = zeroblob(length(params))", "model = 0", "prior_focal_length = 1 - prior_focal_length"],
)
def test_views_of_other_intrinsics_are_no_longer_those_of_the_project(tmp_path: Path, change: str) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    link(path, "a_001.jpg")
    before = only_plan(path)
    assert isinstance(before, LinkStep) and before.step is Step.KEEP
    _run(path, f"UPDATE cameras SET {change}")
    after = only_plan(path)
    assert isinstance(after, DatabaseError) and "add --replace" in str(after)
    replaced = only_plan(path, replace=True)
    assert isinstance(replaced, LinkStep) and digest(replaced.image) != digest(before.image)


def test_a_backup_has_its_name_only_when_it_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "project.db"
    make_project(path)
    opened: list[str] = []
    connect = sqlite3.connect

    def note(name: object, *words: Any, **options: Any) -> sqlite3.Connection:
        opened.append(str(name))
        connection: sqlite3.Connection = connect(str(name), *words, **options)
        return connection

    monkeypatch.setattr(sqlite3, "connect", note)
    copy = link(path, "a_001.jpg", backup=True)
    assert copy is not None and copy.exists()
    assert str(copy) not in opened and any(name.endswith(".bak.tmp") for name in opened)
