"""A user's COLMAP project: the images, keypoints and matches in its database."""

import sqlite3
from collections.abc import Callable, Collection, Container, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.colmap_camera import from_colmap
from blur2view.colmap.connection import open_read_only
from blur2view.colmap.schema import CAMERA_SENSOR, pair_id, read_keypoints, read_matches
from blur2view.exposure.features import NO_POINTS


class Step(StrEnum):
    """What linking does with a photograph."""

    ADD = "add"
    REPLACE = "replace"
    KEEP = "keep"


@dataclass(frozen=True, kw_only=True, eq=False)
class ProjectImage:
    """One image of a project, as it was read, and what linking will do with it."""

    step: Step
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
    """Return the longest suffix of a photograph's path that is an image's name, None if there is none."""
    parts = photograph.absolute().parts
    suffixes = ("/".join(parts[start:]) for start in range(1, len(parts)))
    return next((name for name in suffixes if name in names), None)


def storable(name: str) -> bool:
    """Return whether SQLite can hold a name; it cannot hold bytes that are no UTF-8."""
    return not any("\ud800" <= character <= "\udfff" for character in name)


def has_frames(database: sqlite3.Connection) -> bool:
    """Return whether images of this project have frames; then every image needs one."""
    table = database.execute("SELECT 1 FROM sqlite_master WHERE name = 'frames'").fetchone()
    return bool(table) and database.execute("SELECT 1 FROM frames LIMIT 1").fetchone() is not None


def frame_of(database: sqlite3.Connection, image_id: int) -> int:
    """Return the id of an image's frame; where a project has none mappers give it that of the image."""
    sql = "SELECT frame_id FROM frame_data WHERE data_id = ? AND sensor_type = ?"
    row = database.execute(sql, (image_id, CAMERA_SENSOR)).fetchone() if has_frames(database) else None
    return int((row or (image_id,))[0])


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
    pairs = [pair_id(one, other) for one, other in combinations([image_id, *views], 2)]
    wanted = {"keypoints WHERE image_id": views}
    wanted |= {"matches WHERE pair_id": pairs, "two_view_geometries WHERE pair_id": pairs}
    wanted |= {"frame_data WHERE data_id": views} if has_frames(database) else {}
    found = (
        database.execute(f"SELECT 1 FROM {table} = ?", (key,)).fetchone()
        for table, keys in wanted.items()
        for key in keys
    )
    return all(found)


def database_matcher(path: Path, names: Sequence[str]) -> Callable[[int, int], tuple[Array, Array]]:
    """Return what gives matched pixels (M, 2) of two photographs of a database by the indices of their names.

    Verified matches where it has them; none of what it does not know.
    """

    def matched(first: int, second: int) -> tuple[Array, Array]:
        with open_read_only(path) as database:
            sql = "SELECT image_id FROM images WHERE name IN (?, ?) ORDER BY name = ?"
            ids = database.execute(sql, (names[first], names[second], names[second])).fetchall()
            if len(ids) != 2:
                return NO_POINTS, NO_POINTS
            pair = [int(image_id) for (image_id,) in ids]
            index = read_matches(database, "two_view_geometries", *pair)
            if len(index) == 0:  # not verified
                index = read_matches(database, "matches", *pair)
            one, other = (from_colmap(read_keypoints(database, image_id)) for image_id in pair)
        index = index[(index[:, 0] < len(one)) & (index[:, 1] < len(other))]
        points = np.stack([one[index[:, 0]], other[index[:, 1]]])
        first_points, second_points = points[:, np.isfinite(points).all(axis=(0, 2))]
        return first_points, second_points

    return matched


def database_names(path: Path) -> list[str]:
    """Return the names of a COLMAP database's images, by their ids; those that are no UTF-8 are left out."""
    with open_read_only(path) as database:
        return list(image_names(database))
