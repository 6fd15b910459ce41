"""A user's COLMAP project: the images, keypoints and matches in its database."""

import hashlib
import sqlite3
from collections.abc import Callable, Collection, Container, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.colmap_camera import from_colmap
from blur2view.colmap.connection import open_read_only
from blur2view.colmap.schema import (
    CAMERA_SENSOR,
    MAX_IMAGES,
    keypoints_from_blob,
    matches_from_blob,
    pair_id,
    rig_of,
)
from blur2view.errors import DatabaseError
from blur2view.exposure.neighbours import NO_POINTS


@dataclass(frozen=True, kw_only=True, eq=False)
class ProjectImage:
    """One image of a project, as it was read."""

    image_id: int
    camera_id: int
    name: str
    prior_focal: bool  # whether the project takes the camera's focal length for more than a guess
    keypoints: NDArray[np.float64]  # our pixels (N, 2)
    digest: bytes  # of what its views are made from, its camera and its keypoints, to notice a change


def image_names(database: sqlite3.Connection) -> dict[str, int]:
    """Return the id of every image by its name, in the order of ids; names that are no UTF-8 are left out."""
    rows = database.execute("SELECT name, image_id FROM images ORDER BY image_id").fetchall()
    return {name: number for name, number in rows if isinstance(name, str) and storable(name)}


def longest_suffix(names: Container[str], photograph: Path) -> str | None:
    """Return the longest suffix of a photograph's path that is an image's name, None if there is none.

    So "/data/left/a.jpg" is "left/a.jpg" of a database that has it, else "a.jpg".
    """
    return next((name for name in suffixes(photograph) if name in names), None)


def suffixes(photograph: Path) -> Iterator[str]:
    """Yield the names by which a project may know a photograph, the longest first."""
    parts = photograph.absolute().parts
    return ("/".join(parts[start:]) for start in range(1, len(parts)))


def storable(name: str) -> bool:
    """Return whether SQLite can hold a name; it cannot hold bytes that are no UTF-8."""
    return not any("\ud800" <= character <= "\udfff" for character in name)


def read_image(path: Path, database: sqlite3.Connection, name: str) -> ProjectImage:
    """Return one image of a project with its keypoints; DatabaseError if rows are missing or damaged."""
    sql = (
        "SELECT image_id, camera_id, prior_focal_length, model, width, height, params "
        "FROM images LEFT JOIN cameras USING (camera_id) WHERE name = ?"
    )
    image_id, camera_id, prior, *camera = database.execute(sql, (name,)).fetchone()
    if not 0 <= image_id < MAX_IMAGES:
        raise DatabaseError(f"{path}: image {name} has the id {image_id}; COLMAP's are below {MAX_IMAGES}")
    keypoints_sql = "SELECT rows, cols, data FROM keypoints WHERE image_id = ?"
    row = database.execute(keypoints_sql, (image_id,)).fetchone()
    if row is None or row[0] == 0:
        raise DatabaseError(f"{path}: image {name} has no keypoints; run COLMAP's feature extraction first")
    try:
        keypoints = from_colmap(keypoints_from_blob(*row))
    except ValueError as error:
        raise DatabaseError(
            f"{path}: image {name} is damaged ({error}); run feature extraction again"
        ) from None
    if prior is None:
        raise DatabaseError(f"{path}: image {name} has no camera; the database is damaged")
    if has_frames(database) and rig_of(database, camera_id) is None:
        raise DatabaseError(f"{path}: camera {camera_id} of image {name} has no rig; the database is damaged")
    stored = f"{camera_id} {(bool(prior), *camera)!r} ".encode("utf-8", "backslashreplace") + row[2]
    return ProjectImage(
        image_id=image_id,
        camera_id=camera_id,
        name=name,
        prior_focal=bool(prior),
        keypoints=keypoints,
        digest=hashlib.sha256(stored).digest(),
    )


def has_frames(database: sqlite3.Connection) -> bool:
    """Return whether images of this project have frames; then every image needs one."""
    table = database.execute("SELECT 1 FROM sqlite_master WHERE name = 'frames'").fetchone()
    return bool(table) and database.execute("SELECT 1 FROM frames LIMIT 1").fetchone() is not None


def frame_of(database: sqlite3.Connection, image_id: int) -> int:
    """Return the id of an image's frame; where a project has none mappers give it that of the image."""
    sql = "SELECT frame_id FROM frame_data WHERE data_id = ? AND sensor_type = ?"
    row = database.execute(sql, (image_id, CAMERA_SENSOR)).fetchone() if has_frames(database) else None
    return image_id if row is None else int(row[0])


def own_views(database: sqlite3.Connection, name: str) -> dict[str, tuple[int, bytes | None]]:
    """Return id and source of the existing views of a photograph that blur2view wrote, by role."""
    if not database.execute("SELECT 1 FROM sqlite_master WHERE name = 'blur2view_views'").fetchone():
        return {}
    sql = (
        "SELECT role, image_id, source FROM blur2view_views JOIN images USING (image_id) "
        "WHERE photograph = ? AND name = photograph || '#' || role"
    )
    return {role: (image_id, source) for role, image_id, source in database.execute(sql, (name,))}


def views_are_whole(database: sqlite3.Connection, image_id: int, views: Collection[int]) -> bool:
    """Return whether both views of a photograph have keypoints, frames if there are any, and all pairs."""
    tables = ["keypoints WHERE image_id"] + (["frame_data WHERE data_id"] if has_frames(database) else [])
    wanted = [(table, view) for table in tables for view in views]
    pairs = [pair_id(one, other) for one, other in combinations([image_id, *views], 2)]
    wanted += [
        (f"{table} WHERE pair_id", pair) for table in ("matches", "two_view_geometries") for pair in pairs
    ]
    return all(database.execute(f"SELECT 1 FROM {table} = ?", (key,)).fetchone() for table, key in wanted)


def database_matcher(path: Path, names: Sequence[str]) -> Callable[[int, int], tuple[Array, Array]]:
    """Return what gives matched pixels (M, 2) of two photographs of a database by the indices of their names.

    Verified matches where it has them; none of what it does not know.
    """

    def matched(first: int, second: int) -> tuple[Array, Array]:
        with open_read_only(path) as database:
            sql = "SELECT image_id FROM images WHERE name = ?"
            rows = [database.execute(sql, (names[one],)).fetchone() for one in (first, second)]
            if None in rows or rows[0] == rows[1]:
                return NO_POINTS, NO_POINTS
            try:
                id1, id2 = (int(image_id) for (image_id,) in rows)
                index = read_matches(database, "two_view_geometries", id1, id2)
                if len(index) == 0:  # not verified
                    index = read_matches(database, "matches", id1, id2)
                points1, points2 = (from_colmap(read_keypoints(database, one)) for one in (id1, id2))
            except ValueError as error:
                raise DatabaseError(f"{path}: matches cannot be read ({error}); match again") from None
        inside = (index[:, 0] < len(points1)) & (index[:, 1] < len(points2))
        points1, points2 = points1[index[inside, 0]], points2[index[inside, 1]]
        finite = np.isfinite(points1).all(axis=1) & np.isfinite(points2).all(axis=1)
        return points1[finite], points2[finite]

    return matched


def database_names(path: Path) -> list[str]:
    """Return the names of a COLMAP database's images, by their ids; those that are no UTF-8 are left out."""
    with open_read_only(path) as database:
        return list(image_names(database))


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
