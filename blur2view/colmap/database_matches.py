"""Matched pixels of neighbouring photographs, read from a COLMAP database."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.colmap_camera import from_colmap
from blur2view.errors import DatabaseError
from blur2view.exposure.neighbours import NONE

PAIR_BASE = 2147483647  # COLMAP: pair_id = PAIR_BASE * smaller image_id + larger


class DatabaseMatcher:
    """Matches of a COLMAP database, verified ones where it has them.

    Parameters
    ----------
    path : Path
        The database; it is opened for each pair and only read.
    names : sequence of str
        Of the photographs, as the database has them.
    """

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        self._path, self._names = path, names

    def __call__(self, first: int, second: int) -> tuple[Array, Array]:
        """Give matched pixels (M, 2) of two photographs by their indices, none where it has none.

        Raises
        ------
        DatabaseError
            If the database cannot be read.
        """
        try:
            with closing(_opened(self._path)) as database:
                return _database_matches(database, self._names[first], self._names[second])
        except (sqlite3.Error, TypeError, ValueError) as error:
            raise DatabaseError(
                f"{self._path}: matches cannot be read ({error}); is it a COLMAP database?"
            ) from None


def database_names(path: Path) -> list[str]:
    """Names of a COLMAP database's images, by their ids; those that are no UTF-8 are left out.

    Raises
    ------
    DatabaseError
        If the database cannot be read.
    """
    try:
        with closing(_opened(path)) as database:
            database.text_factory = lambda name: name.decode() if _is_text(name) else name
            rows = database.execute("SELECT name FROM images ORDER BY image_id").fetchall()
    except (sqlite3.Error, UnicodeError) as error:
        raise DatabaseError(f"{path}: images cannot be read ({error}); is it a COLMAP database?") from None
    return [name for (name,) in rows if isinstance(name, str)]


def _is_text(name: bytes) -> bool:
    """Whether bytes are UTF-8."""
    return name.decode("utf-8", "ignore").encode() == name


def _opened(path: Path) -> sqlite3.Connection:
    # for writing, which is not done: a read-only connection leaves the files of a write-ahead log behind
    return sqlite3.connect(f"{path.resolve().as_uri()}?mode=rw", uri=True, timeout=2)


def _database_matches(database: sqlite3.Connection, name1: str, name2: str) -> tuple[Array, Array]:
    id1, id2 = (_image_id(database, name) for name in (name1, name2))
    if id1 is None or id2 is None or id1 == id2:
        return NONE, NONE
    index = _pair_rows(database, PAIR_BASE * min(id1, id2) + max(id1, id2))
    index = index if id1 < id2 else index[:, ::-1]  # COLMAP's pairs begin with the smaller id
    points1, points2 = _keypoints(database, id1), _keypoints(database, id2)
    inside = (index[:, 0] < len(points1)) & (index[:, 1] < len(points2))
    return points1[index[inside, 0]], points2[index[inside, 1]]


def _image_id(database: sqlite3.Connection, name: str) -> int | None:
    row = database.execute("SELECT image_id FROM images WHERE name = ?", (name,)).fetchone()
    return None if row is None else int(row[0])


def _pair_rows(database: sqlite3.Connection, pair_id: int) -> NDArray[np.uint32]:
    """Give the indices (M, 2) of a pair's inliers, or of its matches where none were verified."""
    for table in ("two_view_geometries", "matches"):
        row = database.execute(f"SELECT data FROM {table} WHERE pair_id = ?", (pair_id,)).fetchone()
        if row is not None and row[0]:
            return np.frombuffer(row[0], np.uint32).reshape(-1, 2)
    return np.zeros((0, 2), np.uint32)


def _keypoints(database: sqlite3.Connection, image_id: int) -> Array:
    """Give our pixels (N, 2) of an image's keypoints."""
    query = "SELECT rows, cols, data FROM keypoints WHERE image_id = ?"
    row = database.execute(query, (image_id,)).fetchone()
    if row is None or not row[2]:
        return NONE
    return from_colmap(np.frombuffer(row[2], np.float32).reshape(row[0], row[1])[:, :2].astype(float))
