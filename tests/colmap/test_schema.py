"""What is known of COLMAP's database, compared with a file that pycolmap writes."""

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view import Configuration
from blur2view.colmap import schema as colmap_schema
from blur2view.colmap.schema import (
    MAX_IMAGES,
    MODELS,
    NEWEST_KNOWN,
    SCHEMA_VERSION,
    TABLES,
    keypoints_blob,
    keypoints_from_blob,
    matches_blob,
    matrix_blob,
    model_number,
    pair_id,
    quaternion,
)
from blur2view.geometry.rotation import rotation_matrix


def shape_of(path: Path) -> dict[str, object]:
    """Columns, foreign keys and indices of every table, and the version."""
    with closing(sqlite3.connect(path)) as database:
        parts: dict[str, object] = {}
        tables = "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%'"
        for (table,) in database.execute(tables).fetchall():
            for pragma in ("table_info", "foreign_key_list"):
                parts[f"{table} {pragma}"] = database.execute(f"PRAGMA {pragma}({table})").fetchall()
            rows = database.execute(f"PRAGMA index_list({table})").fetchall()
            for name, unique in sorted((row[1], row[2]) for row in rows):
                columns = database.execute(f"PRAGMA index_info({name})").fetchall()
                parts[f"{table} {name}"] = unique, columns
        return parts


@pytest.fixture(scope="module")
def theirs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("theirs") / "theirs.db"
    with pycolmap.Database.open(path):
        pass
    return path


def test_tables_are_those_of_pycolmap(theirs: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(tmp_path / "ours.db")) as database:
        database.executescript(TABLES)
    assert shape_of(tmp_path / "ours.db") == shape_of(theirs)


def test_version_is_one_that_pycolmap_writes(theirs: Path) -> None:
    with closing(sqlite3.connect(theirs)) as database:
        version = database.execute("PRAGMA user_version").fetchone()[0]
    assert version // 10000 == SCHEMA_VERSION // 10000
    assert SCHEMA_VERSION <= NEWEST_KNOWN and version <= NEWEST_KNOWN


def test_numbers_are_those_of_pycolmap() -> None:
    theirs = pycolmap.TwoViewGeometryConfiguration.__members__
    assert [int(theirs[config]) for config in Configuration] == list(range(len(Configuration)))
    models = pycolmap.CameraModelId.__members__
    assert {name: int(models[name]) for name in MODELS} == MODELS
    assert model_number("OPENCV_FISHEYE") == int(models["OPENCV_FISHEYE"])
    assert pycolmap.SensorType.CAMERA.value == colmap_schema.CAMERA_SENSOR


def test_pycolmap_writes_the_blobs_that_we_pack(tmp_path: Path) -> None:
    path, rng = tmp_path / "theirs.db", np.random.default_rng(0)
    points, used = rng.uniform(0, 500, (7, 2)), np.array([1, 3, 4])
    matrices = {name: rng.normal(size=(3, 3)) for name in "FEH"}
    turn, t = pycolmap.Rotation3d(np.array([0.1, -0.2, 0.3])), np.array([0.6, 0.0, 0.8])
    geometry = pycolmap.TwoViewGeometry(config=2, **matrices)
    geometry.inlier_matches = np.stack([used, used], axis=1).astype(np.uint32)
    geometry.cam2_from_cam1 = pycolmap.Rigid3d(turn, t)
    with pycolmap.Database.open(path) as database:
        camera = pycolmap.Camera.create_from_model_name(0, "SIMPLE_PINHOLE", 500.0, 640, 480)
        camera.camera_id = database.write_camera(camera)
        ids = [database.write_image(pycolmap.Image(name=n, camera_id=camera.camera_id)) for n in "ab"]
        database.write_keypoints(ids[0], points.astype(np.float32))
        database.write_two_view_geometry(ids[0], ids[1], geometry)
    with closing(sqlite3.connect(path)) as database:
        stored = database.execute("SELECT rows, cols, data FROM keypoints").fetchone()
        columns = "pair_id, data, F, E, H, qvec, tvec"
        row = database.execute(f"SELECT {columns} FROM two_view_geometries").fetchone()
    assert stored == (7, 2, keypoints_blob(points))
    np.testing.assert_array_equal(keypoints_from_blob(*stored), points.astype(np.float32))
    packed = [matrix_blob(matrices[name]) for name in "FEH"]
    assert row[:5] == (pair_id(*ids), matches_blob(used), *packed)
    np.testing.assert_allclose(np.frombuffer(row[5]), quaternion(turn.matrix()), atol=1e-12)
    assert row[6] == matrix_blob(t)


def test_pairs_of_images_have_one_key() -> None:
    for ids in ((3, 17), (1, MAX_IMAGES - 1)):
        assert pycolmap.pair_id_to_image_pair(pair_id(*ids)) == ids
    for wrong in ((17, 3), (3, 3), (-1, 3), (3, MAX_IMAGES)):
        with pytest.raises(ValueError, match="must rise"):
            pair_id(*wrong)


@pytest.mark.parametrize(
    "row",
    [
        (2, 2, b"\0" * 15),
        (2, 3, b"\0" * 24),
        (-1, 2, b""),
        ("2", 2, b"\0" * 16),
        (1, 2, "text"),
        (1, 2, None),
    ],
)
def test_refuses_keypoints_that_contradict_themselves(row: tuple[object, object, object]) -> None:
    with pytest.raises(ValueError, match="keypoints"):
        keypoints_from_blob(*row)


def test_quaternions_have_no_negative_real_part() -> None:
    axes = np.random.default_rng(0).normal(size=(40, 3))
    for axis, angle in zip(axes, np.linspace(0.1, 6.2, 40), strict=True):
        R = rotation_matrix(angle * axis / np.linalg.norm(axis))
        q = quaternion(R)
        assert q[0] >= 0
        assert np.allclose(pycolmap.Rotation3d(q[[1, 2, 3, 0]]).matrix(), R)
