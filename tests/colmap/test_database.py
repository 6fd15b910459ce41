"""Fresh COLMAP databases, read back by pycolmap."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from blur2view.camera import Camera
from blur2view.colmap.database import to_colmap_camera, write_database
from blur2view.colmap.project import CAMERA_SENSOR, MAX_IMAGES, NEWEST_KNOWN, pair_id
from blur2view.errors import DatabaseError
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.configuration import Configuration
from blur2view.geometry.pose import RigidTransform, rotation_matrix
from tests.support.colmap_projects import check_database, make_project, run_sql, some_views, user_rows

SIZE, COUNT = (640, 480), 30
CAMERA = Camera.from_focal(525.0, SIZE)
POSE = RigidTransform(
    rotation=rotation_matrix(np.array([0.01, -0.02, 0.03])), translation=np.array([0.6, 0, 0.8])
)


def make_views(name: str = "a.jpg") -> ExposureViews:
    """Return views with a geometry that has all of its parts."""
    plain = some_views(name, COUNT)
    geometry = replace(plain.geometry, H=np.eye(3), cam2_from_cam1=POSE, config=Configuration.CALIBRATED)
    return replace(plain, size=SIZE, camera=CAMERA, geometry=geometry)


def test_pycolmap_reads_what_was_written(tmp_path: Path) -> None:
    path, views = tmp_path / "new.db", make_views()
    write_database(str(path), [views])
    assert check_database(path) == []
    with pycolmap.Database.open(path) as database:
        images = {image.name: image for image in database.read_all_images()}
        assert list(images) == ["a.jpg#open", "a.jpg#close"]
        first, last = (images[name] for name in views.names)
        assert len({image.frame_id for image in images.values()}) == 2
        camera = database.read_camera(first.camera_id)
        found = database.read_two_view_geometry(first.image_id, last.image_id)
        keypoints = database.read_keypoints(last.image_id)
        matches = database.read_matches(first.image_id, last.image_id)
    assert (camera.model_name, camera.has_prior_focal_length) == ("SIMPLE_PINHOLE", True)
    np.testing.assert_allclose(camera.params, [525, 320, 240])
    np.testing.assert_allclose(keypoints, views.points_close + 0.5, atol=1e-4)
    np.testing.assert_array_equal(matches, np.stack([np.arange(COUNT)] * 2, axis=1))
    used, expected = np.flatnonzero(views.geometry.inlier_mask), views.geometry.to_pycolmap()
    np.testing.assert_array_equal(found.inlier_matches, np.stack([used, used], axis=1))
    for name in ("F", "E", "H"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-12)
    assert found.config == expected.config == int(pycolmap.TwoViewGeometryConfiguration.CALIBRATED)
    assert found.cam2_from_cam1 is not None
    pose = expected.cam2_from_cam1.matrix()
    np.testing.assert_allclose(found.cam2_from_cam1.matrix(), pose, atol=1e-12)


def test_without_geometry_nothing_is_matched(tmp_path: Path) -> None:
    path, views = tmp_path / "new.db", make_views()
    none: dict[str, Any] = dict.fromkeys(("F", "H", "cam2_from_cam1"))
    without = replace(views.geometry, config=Configuration.DEGENERATE, **none)
    write_database(path, [replace(views, geometry=without)])
    assert check_database(path) == []
    with pycolmap.Database.open(path) as database:
        found = database.read_two_view_geometry(1, 2)
        assert len(found.inlier_matches) == len(database.read_matches(1, 2)) == 0
        assert found.config == int(pycolmap.TwoViewGeometryConfiguration.DEGENERATE)
        assert found.F is None and found.cam2_from_cam1 is None
        assert len(database.read_keypoints(1)) == COUNT


def test_cameras_say_how_sure_they_are() -> None:
    def stored(camera: Camera | None) -> tuple[str, list[float], bool]:
        one = to_colmap_camera(camera, SIZE)
        assert (one.width, one.height) == SIZE
        return one.model_name, one.params.tolist(), one.has_prior_focal_length

    default = pycolmap.Camera.create_from_model_name(0, "SIMPLE_RADIAL", 1.2 * 640, *SIZE)
    assert stored(None) == ("SIMPLE_RADIAL", default.params.tolist(), False)
    hint = replace(CAMERA, log_focal_sigma=0.1)
    assert stored(hint) == ("SIMPLE_RADIAL", [525, 320, 240, 0], True)
    assert stored(Camera(K=CAMERA.K, width=640, height=480)) == ("PINHOLE", [525, 525, 320, 240], True)
    lens = Camera.from_string("OPENCV 640 480 500 510 320 240 0.1 0.01 0 0")
    assert stored(lens) == ("OPENCV", list(lens.params), True)


def test_an_existing_file_is_refused_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "new.db"
    path.write_text("mine")
    (loop := tmp_path / "loop.db").symlink_to(loop)
    for there in (path, loop):
        with pytest.raises(DatabaseError, match="exists; choose another --db"):
            write_database(there, [make_views()])
    assert path.read_text() == "mine"
    with pytest.raises(DatabaseError, match="cannot be written .File name too long"):
        write_database(tmp_path / ("x" * 300), [make_views()])
    with pytest.raises(DatabaseError, match="cannot be written"):
        write_database(path / "new.db", [make_views()])


@pytest.mark.parametrize(
    "theirs", ["images SELECT 9, 'theirs.png', 1", "matches VALUES (7, 0, 2, NULL)"], ids=["image", "pair"]
)
def test_a_database_of_views_alone_is_replaced_and_no_other(tmp_path: Path, theirs: str) -> None:
    path = tmp_path / "new.db"
    for name in ("a.jpg", "b.jpg"):
        write_database(path, [make_views(name)])
    assert run_sql(path, "SELECT name FROM images") == [("b.jpg#close",), ("b.jpg#open",)]
    run_sql(path, f"INSERT INTO {theirs}")
    before = path.read_bytes()
    with pytest.raises(DatabaseError, match="exists; choose another --db"):
        write_database(path, [make_views()])
    assert path.read_bytes() == before


KILLED = (
    "import os, pycolmap; a = pycolmap.Database.open('new.db'); a.write_camera(a.read_camera(1)); os._exit(9)"
)


def test_the_log_of_a_killed_mapper_does_not_damage_a_new_database(tmp_path: Path) -> None:
    path, log = tmp_path / "new.db", tmp_path / "new.db-wal"
    write_database(path, [make_views()])
    subprocess.run([sys.executable, "-c", KILLED], cwd=tmp_path)
    assert log.stat().st_size
    old = path.read_bytes(), log.read_bytes()
    with pytest.raises(DatabaseError, match="or open it once with COLMAP"):
        write_database(path, [make_views("b.jpg")])
    assert (path.read_bytes(), log.read_bytes()) == old
    path.unlink()
    log.write_bytes(old[1])  # of a database that a user has removed alone
    with pytest.raises(DatabaseError, match="new.db-wal: is a log that SQLite would apply"):
        write_database(path, [make_views()])


@pytest.mark.parametrize("second", ["a.jpg", "\udcff.jpg"])
def test_names_that_a_database_cannot_hold_are_refused(tmp_path: Path, second: str) -> None:
    with pytest.raises(ValueError, match="photographs must have different names, all of them UTF-8"):
        write_database(tmp_path / "new.db", [make_views(), replace(make_views(), name=second)])
    assert list(tmp_path.iterdir()) == []


def test_numbers_are_those_of_pycolmap(tmp_path: Path) -> None:
    pycolmap.Database.open(tmp_path / "theirs.db").close()
    assert run_sql(tmp_path / "theirs.db", "PRAGMA user_version")[0][0] <= NEWEST_KNOWN
    assert {*Configuration} <= {*pycolmap.TwoViewGeometryConfiguration.__members__}
    assert pycolmap.SensorType.CAMERA.value == CAMERA_SENSOR
    for ids in ((3, 17), (1, MAX_IMAGES - 1)):
        assert pycolmap.pair_id_to_image_pair(pair_id(*ids)) == ids
        assert pair_id(*ids[::-1]) == pair_id(*ids)


def test_database_that_came_meanwhile_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "new.db"
    monkeypatch.setattr("blur2view.colmap.database._views_alone", lambda _: str(make_project(path)).encode())
    with pytest.raises(DatabaseError, match="exists"):
        write_database(path, [some_views()])
    assert user_rows(path)["images"]
