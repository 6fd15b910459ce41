"""What is known of COLMAP's database, compared with a file that pycolmap writes."""

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from blur2view import Configuration
from blur2view.colmap.schema import CAMERA_SENSOR, MAX_IMAGES, NEWEST_KNOWN, pair_id, quaternion
from blur2view.geometry.rotation import rotation_matrix


def test_version_is_that_of_pycolmap(tmp_path: Path) -> None:
    pycolmap.Database.open(tmp_path / "theirs.db").close()
    with closing(sqlite3.connect(tmp_path / "theirs.db")) as database:
        assert database.execute("PRAGMA user_version").fetchone()[0] <= NEWEST_KNOWN


def test_numbers_are_those_of_pycolmap() -> None:
    theirs = pycolmap.TwoViewGeometryConfiguration.__members__
    assert [int(theirs[config]) for config in Configuration] == list(range(len(Configuration)))
    assert pycolmap.SensorType.CAMERA.value == CAMERA_SENSOR


def test_pairs_of_images_have_one_key() -> None:
    for ids in ((3, 17), (1, MAX_IMAGES - 1)):
        assert pycolmap.pair_id_to_image_pair(pair_id(*ids)) == ids
        assert pair_id(*ids[::-1]) == pair_id(*ids)
    for wrong in ((3, 3), (-1, 3), (3, MAX_IMAGES)):
        with pytest.raises(ValueError, match="must differ"):
            pair_id(*wrong)


def test_quaternions_have_no_negative_real_part() -> None:
    axes = np.random.default_rng(0).normal(size=(40, 3))
    for axis, angle in zip(axes, np.linspace(0.1, 6.2, 40), strict=True):
        R = rotation_matrix(angle * axis / np.linalg.norm(axis))
        q = quaternion(R)
        assert q[0] >= 0
        assert np.allclose(pycolmap.Rotation3d(q[[1, 2, 3, 0]]).matrix(), R)
