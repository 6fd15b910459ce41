"""What is known of COLMAP's database, compared with a file that pycolmap writes."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pycolmap
import pytest

from blur2view import Configuration
from blur2view.colmap.schema import CAMERA_SENSOR, MAX_IMAGES, NEWEST_KNOWN, pair_id


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
