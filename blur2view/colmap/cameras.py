"""The cameras of a COLMAP database: what ``--camera project.db`` names."""

from __future__ import annotations

import os
from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.camera.camera import Camera
from blur2view.camera.colmap_camera import colmap_camera
from blur2view.colmap.connection import open_read_only
from blur2view.errors import CameraError, DatabaseError

MOST_NAMED = 10  # camera ids in a message


@dataclass(frozen=True, kw_only=True)
class StoredCamera:
    """A camera of a COLMAP database, looked up for every photograph.

    Parameters
    ----------
    database : Path
    camera_id : int or None
        None: that of the image whose name the photograph's path ends with, else the only one.
    """

    database: Path
    camera_id: int | None = None

    def __call__(self, photograph: Path) -> Camera:
        """Return the camera of a photograph; CameraError if the database cannot be used or leaves it open."""
        return camera_of_database(self.database, self.camera_id, str(photograph))


def stored_camera(text: str) -> StoredCamera | None:
    """Return what "path.db" or "path.db:ID" names: a path that exists or looks like one; None otherwise."""
    path, colon, number = text.rpartition(":")
    if colon and number.isdecimal():
        return StoredCamera(database=Path(path), camera_id=int(number))
    looks_like_one = text.endswith(".db") or os.path.isfile(text)
    return StoredCamera(database=Path(text)) if looks_like_one else None


def camera_of_database(
    path: str | os.PathLike[str], camera_id: int | None = None, image_name: str = ""
) -> Camera:
    """Return a camera of a COLMAP database, of any version: by id, else the image's, else the only one.

    ``image_name`` is the photograph's path; the database's image whose name it ends with is taken for it.
    CameraError if the database cannot be read, has no such camera, or leaves the choice open.
    """
    path = Path(path)
    try:
        with open_read_only(path) as database:
            rows = database.execute("SELECT camera_id, model, width, height, params FROM cameras").fetchall()
            of_image = dict(database.execute("SELECT name, camera_id FROM images").fetchall())
    except DatabaseError as error:
        raise CameraError(str(error)) from None
    by_id = {row[0]: row[1:] for row in rows}
    if camera_id is None:
        camera_id = _camera_of(path, by_id, of_image, image_name)
    if camera_id not in by_id:
        raise CameraError(f"{path}: has no camera {camera_id}; it has {_some(by_id)}")
    return Camera.from_colmap(
        _colmap_camera(path, camera_id, *by_id[camera_id]), f"database, camera {camera_id}"
    )


def _colmap_camera(path: Path, camera_id: int, model: Any, width: Any, height: Any, params: Any) -> Any:
    """Return the pycolmap.Camera of a row, whose values may be of any type."""
    import pycolmap

    try:
        name = pycolmap.CameraModelId.__members__[pycolmap.CameraModelId(model).name].name
        values = tuple(np.frombuffer(params, np.float64).tolist())
        width, height = int(width), int(height)
    except (KeyError, TypeError, ValueError, OverflowError):  # OverflowError: of an infinite width
        raise CameraError(
            f"{path}: camera {camera_id} is of a kind this pycolmap does not know; update pycolmap"
        ) from None
    return colmap_camera(name, width, height, values)


def _camera_of(path: Path, ids: dict[int, Any], of_image: dict[str, int], image_name: str) -> int:
    """Return the camera of the image whose name is the longest suffix of the path, else the only one."""
    name = longest_suffix(of_image, Path(image_name)) if image_name else None
    if name is not None:
        return of_image[name]
    if len(ids) == 1:
        return int(next(iter(ids)))
    raise CameraError(
        f"{path}: knows no image {Path(image_name).name} and has several cameras or none ({_some(ids)}); "
        f"name one as {path}:ID"
    )


def _some(ids: dict[int, Any]) -> str:
    """Return the first of the ids, for a message."""
    named = list(map(str, ids))
    more = [] if len(named) <= MOST_NAMED else [f"{len(named) - MOST_NAMED} more"]
    return ", ".join(named[:MOST_NAMED] + more) or "none"


def longest_suffix(names: Container[str], photograph: Path) -> str | None:
    """Return the longest suffix of a photograph's path that is an image's name, None if there is none.

    So "/data/left/a.jpg" is "left/a.jpg" of a database that has it, else "a.jpg".
    """
    parts = photograph.absolute().parts
    suffixes = ("/".join(parts[start:]) for start in range(1, len(parts)))
    return next((name for name in suffixes if name in names), None)
