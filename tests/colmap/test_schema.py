"""What is known of COLMAP's database, compared with a file that pycolmap writes."""

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view import Configuration
from blur2view.colmap.schema import (
    CAMERA_SENSOR,
    MAX_IMAGES,
    MODELS,
    NEWEST_KNOWN,
    SCHEMA_VERSION,
    TABLES,
    keypoints_from_blob,
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
    assert pycolmap.SensorType.CAMERA.value == CAMERA_SENSOR


def test_pairs_of_images_have_one_key() -> None:
    for ids in ((3, 17), (1, MAX_IMAGES - 1)):
        assert pycolmap.pair_id_to_image_pair(pair_id(*ids)) == ids
        assert pair_id(*ids[::-1]) == pair_id(*ids)
    for wrong in ((3, 3), (-1, 3), (3, MAX_IMAGES)):
        with pytest.raises(ValueError, match="must differ"):
            pair_id(*wrong)


@pytest.mark.parametrize(
    "row",
    [(2, 2, bytes(15)), (2, 3, bytes(24)), (-1, 2, b""), ("2", 2, bytes(16)), (1, 2, "text"), (1, 2, None)],
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
