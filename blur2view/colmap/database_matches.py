"""Keypoints of photographs and their matches, read from a COLMAP database."""

import sqlite3
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.colmap_camera import from_colmap
from blur2view.colmap.connection import open_read_only
from blur2view.colmap.project import image_names
from blur2view.colmap.schema import keypoints_from_blob, matches_from_blob, pair_id
from blur2view.errors import DatabaseError
from blur2view.exposure.neighbours import NO_POINTS


class DatabaseMatcher:
    """Matches of photographs of a COLMAP database, verified ones where it has them."""

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        self._path, self._names = path, names

    def __call__(self, first: int, second: int) -> tuple[Array, Array]:
        """Return matched pixels (M, 2) of two photographs by their indices, none where it has none."""
        try:
            with open_read_only(self._path) as database:
                return _matched_points(database, self._names[first], self._names[second])
        except ValueError as error:
            raise DatabaseError(f"{self._path}: matches cannot be read ({error}); match again") from None


def database_names(path: Path) -> list[str]:
    """Return the names of a COLMAP database's images, by their ids; those that are no UTF-8 are left out."""
    with open_read_only(path) as database:
        return list(image_names(database))


def _matched_points(database: sqlite3.Connection, name1: str, name2: str) -> tuple[Array, Array]:
    """Return matched pixels (M, 2) of two images, none where one is missing; ValueError of damaged rows."""
    sql = "SELECT image_id FROM images WHERE name = ?"
    rows = [database.execute(sql, (name,)).fetchone() for name in (name1, name2)]
    if None in rows or rows[0] == rows[1]:
        return NO_POINTS, NO_POINTS
    id1, id2 = (int(image_id) for (image_id,) in rows)
    index = read_matches(database, "two_view_geometries", id1, id2)
    if len(index) == 0:  # not verified
        index = read_matches(database, "matches", id1, id2)
    points1, points2 = (from_colmap(read_keypoints(database, image_id)) for image_id in (id1, id2))
    inside = (index[:, 0] < len(points1)) & (index[:, 1] < len(points2))
    points1, points2 = points1[index[inside, 0]], points2[index[inside, 1]]
    finite = np.isfinite(points1).all(axis=1) & np.isfinite(points2).all(axis=1)
    return points1[finite], points2[finite]


def read_matches(database: sqlite3.Connection, table: str, id1: int, id2: int) -> NDArray[np.int64]:
    """Return the indices (M, 2) of the matched keypoints of two images, in either order of their ids.

    ``table`` is "matches", or "two_view_geometries" for the inliers. ValueError if a row contradicts itself.
    """
    query = f"SELECT rows, cols, data FROM {table} WHERE pair_id = ?"
    row = database.execute(query, (pair_id(id1, id2),)).fetchone()
    index = np.zeros((0, 2), np.int64) if row is None else matches_from_blob(*row)
    return index if id1 < id2 else index[:, ::-1]  # a row leads from the smaller id


def read_keypoints(database: sqlite3.Connection, image_id: int) -> NDArray[np.float64]:
    """Return COLMAP's pixels (N, 2) of an image's keypoints; ValueError if the row contradicts itself."""
    query = "SELECT rows, cols, data FROM keypoints WHERE image_id = ?"
    row = database.execute(query, (image_id,)).fetchone()
    return NO_POINTS if row is None else keypoints_from_blob(*row)
