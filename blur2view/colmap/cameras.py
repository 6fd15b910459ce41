"""The cameras of a COLMAP database: what ``--camera project.db`` names."""

import os
from pathlib import Path

import numpy as np

from blur2view.camera import Camera, colmap_camera
from blur2view.colmap.project import image_names, longest_suffix, open_read_only
from blur2view.errors import CameraError, DatabaseError

MAX_PARAMETERS = 32  # of a camera; no model has half as many


def database_named(text: str) -> tuple[Path, int | None] | None:
    """Return the database and the camera's id of "path.db" or "path.db:ID"; None of any other text.

    A path exists, or ends in .db.
    """
    path, colon, number = text.rpartition(":")
    if colon and number.isdecimal():
        return Path(path), int(number)
    looks_like_one = text.endswith(".db") or os.path.isfile(text)
    return (Path(text), None) if looks_like_one else None


def camera_of_database(
    path: str | os.PathLike[str], camera_id: int | None = None, image_name: str = ""
) -> Camera:
    """Return a camera of a COLMAP database: by id, else the image's, else the only one.

    ``image_name`` is the photograph's path; the image whose name it ends with is taken for it. CameraError
    if the database cannot be read, has no such camera, or leaves the choice open.
    """
    import pycolmap

    path = Path(path)
    try:
        with open_read_only(path) as database:
            rows = database.execute("SELECT camera_id, model, width, height, params FROM cameras")
            cameras = {number: row for number, *row in rows}
            names = image_names(database)
            name = longest_suffix(names, Path(image_name)) if image_name else None
            if camera_id is None and name is not None:
                sql = "SELECT camera_id FROM images WHERE image_id = ?"
                (camera_id,) = database.execute(sql, (names[name],)).fetchone()
    except DatabaseError as error:
        raise CameraError(str(error)) from None
    if camera_id is None and len(cameras) == 1:
        (camera_id,) = cameras
    if camera_id not in cameras:
        some = ", ".join(map(str, [*cameras][:10])) + " ..." * (len(cameras) > 10) or "none"
        wanted = f"no image {Path(image_name).name}" if camera_id is None else f"no camera {camera_id!r:.20}"
        raise CameraError(f"{path}: has {wanted}; it has cameras {some}; name one as {path}:ID")
    model, width, height, params = cameras[camera_id]  # of any type
    try:
        kind = pycolmap.CameraModelId.__members__[pycolmap.CameraModelId(model).name].name
        values = tuple(np.frombuffer(params, np.float64)[:MAX_PARAMETERS].tolist())
        camera = colmap_camera(kind, int(width), int(height), values)
        return Camera.from_colmap(camera, f"database, camera {camera_id}")
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError, OverflowError):  # OverflowError: of an infinite width
        why = "is of a kind this pycolmap does not know; update pycolmap"
        raise CameraError(f"{path}: camera {camera_id} {why}") from None
