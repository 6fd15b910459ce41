"""Both virtual images of blurred photographs in a COLMAP database: their rows, and a fresh database."""

import os
import shutil
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.camera.camera import Camera
from blur2view.camera.colmap_camera import colmap_camera, to_colmap
from blur2view.colmap.connection import LOGS, connect, database_errors, open_read_only
from blur2view.colmap.project import ProjectImage, has_frames, own_views
from blur2view.colmap.schema import MAX_IMAGES, VIEWS_TABLE, add_camera, put_image, put_keypoints, put_pair
from blur2view.errors import DatabaseError
from blur2view.exposure.end_order import GUESSED_FOCAL
from blur2view.exposure.half_exposure import half_geometry
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.two_view_geometry import Parallax, TwoViewGeometry
from blur2view.output_files import half_written, remove_left_over

# A row that is not of views, and of matches that are not of one photograph's both views.
NO_VIEWS = f"""
WITH pairs AS (SELECT {MAX_IMAGES} * min(image_id) + max(image_id) FROM blur2view_views
  GROUP BY photograph HAVING count(*) = 2)
SELECT 1 FROM images WHERE image_id NOT IN (SELECT image_id FROM blur2view_views)
UNION ALL SELECT 1 FROM descriptors
UNION ALL SELECT 1 FROM matches WHERE pair_id NOT IN pairs
UNION ALL SELECT 1 FROM two_view_geometries WHERE pair_id NOT IN pairs
LIMIT 1"""


def write_database(
    path: str | os.PathLike[str], photographs: Sequence[ExposureViews], *, replace: bool = False
) -> None:
    """Write a database that holds nothing but these views; it appears whole or not at all.

    Photographs with equal cameras share one. Without F and H nothing is matched: the ends' order would mean
    nothing. The table ``blur2view_views`` says of each whether its time direction is known. With ``replace``
    a file of this name is replaced, once the new one is whole.
    DatabaseError if the file exists or cannot be written; ValueError if two photographs have one name.
    """
    names, path = [views.name for views in photographs], Path(path)
    if len(set(names)) != len(names):
        raise ValueError(f"photographs must have different names, got {names}")
    if not replace:
        refuse_existing(path)
    beside = half_written(path)
    try:
        remove_left_over({path}, [path.parent])
        _write_views(beside, photographs)
        if replace and path.is_file():
            # settle its log or journal, or SQLite would apply it to what takes its place; it may be in use
            with database_errors(path), closing(connect(path, "mode=rw")) as old:
                old.execute("PRAGMA journal_mode = DELETE")
                old.execute("SELECT 1 FROM sqlite_master")
        else:
            refuse_existing(path)  # may have come meanwhile
        beside.replace(path)
    except (sqlite3.Error, OSError, RuntimeError) as error:  # RuntimeError: of pycolmap
        why = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise DatabaseError(f"{path}: cannot be written ({why}); choose another --db") from None
    finally:
        beside.unlink(missing_ok=True)


def _write_views(path: Path, photographs: Iterable[ExposureViews]) -> None:
    """Write a database of views, the file itself by pycolmap."""
    import pycolmap

    with TemporaryDirectory() as folder:  # where its write-ahead log disturbs nobody
        pycolmap.Database.open(Path(folder) / "new.db").close()
        shutil.copyfile(Path(folder) / "new.db", path)
    cameras: list[Any] = []
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute("PRAGMA journal_mode = MEMORY")  # a half-written file is thrown away
        database.execute("PRAGMA foreign_keys = ON")
        database.executescript(f"BEGIN; {VIEWS_TABLE}")
        for views in photographs:
            camera = colmap_camera_of(views.camera, views.size)
            if camera not in cameras:
                cameras.append(camera)
                add_camera(database, camera)
            put_views(database, views, 1 + cameras.index(camera))
        database.execute("COMMIT")


def put_views(
    database: sqlite3.Connection, views: ExposureViews, camera_id: int, photograph: ProjectImage | None = None
) -> None:
    """Write both images of a photograph and their pair, in place of those that it had.

    Of a photograph of a project also its pairs with both, and the table ``blur2view_views`` says what of it
    they are made from.
    """
    own = {} if photograph is None else own_views(database, photograph.name)
    with_frame = photograph is None or has_frames(database)
    ids, sides = [], zip(("open", "close"), views.names, (views.points_open, views.points_close), strict=True)
    for role, name, points in sides:
        image_id, _ = own.get(role, (None, None))
        image_id = put_image(database, name, camera_id, image_id, with_frame=with_frame)
        put_keypoints(database, image_id, points)
        time = int(views.time.known), views.time.confidence
        source = None if photograph is None else photograph.digest
        row = (image_id, views.name, role, views.geometry.config.name, *time, source)
        database.execute("INSERT OR REPLACE INTO blur2view_views VALUES (?, ?, ?, ?, ?, ?, ?)", row)
        ids.append(image_id)
    first, last = ids
    whole, used = views.geometry, inliers(views)
    pairs = {(first, last): whole}
    if photograph is not None:
        used = np.flatnonzero(whole.inlier_mask)
        for end, geometry in ((first, whole.reversed()), (last, whole)):
            pairs[photograph.image_id, end] = half_geometry(geometry, views.camera, views.size)
    for pair, geometry in pairs.items():
        put_pair(database, pair, geometry, matched(views), used)


def colmap_camera_of(camera: Camera | None, size: tuple[int, int]) -> Any:
    """Return the pycolmap.Camera of a photograph, whose width and height are ``size``, pixels.

    Known intrinsics are written as they are. A hint keeps its focal length as a prior and gets room for a
    distortion; without any camera the same holds of COLMAP's own guess, which is no prior.
    """
    if camera is not None and camera.known:
        model, params = camera.model, camera.params
    elif camera is not None:
        model, params = "SIMPLE_RADIAL", (camera.focal_px, *to_colmap(camera.K[:2, 2]).tolist(), 0.0)
    else:
        model, params = "SIMPLE_RADIAL", (GUESSED_FOCAL * max(size), size[0] / 2, size[1] / 2, 0.0)
    stored = colmap_camera(model, *size, params)
    stored.has_prior_focal_length = camera is not None
    return stored


def refuse_existing(path: Path) -> None:
    """Raise a DatabaseError where something lies at a path, or its folder takes no files."""
    if os.path.lexists(path):
        raise DatabaseError(f"{path}: exists; choose another --db, or add to a project of yours with --link")
    for log in (f"{path}{suffix}" for suffix in LOGS):
        if os.path.lexists(log):  # which SQLite would apply to the new database
            raise DatabaseError(f"{log}: is of a database that is gone; remove it, or choose another --db")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise DatabaseError(f"{path}: {path.parent} is no folder that can be written; choose another --db")


def holds_views_alone(path: Path) -> bool:
    """Return whether a database of ours holds nothing but views, each matched with the other of its pair."""
    try:
        with open_read_only(path) as database:
            return database.execute(NO_VIEWS).fetchone() is None
    except DatabaseError:
        return False


def stored_photographs(path: Path) -> set[str]:
    """Return the names of the photographs whose views a database of ours holds."""
    with open_read_only(path) as database:
        return {str(name) for (name,) in database.execute("SELECT photograph FROM blur2view_views")}


def matched(views: ExposureViews) -> NDArray[np.int_]:
    """Return the indices of the usable points if their order is known up to time reversal, else of none."""
    if views.usable is not None:
        return np.flatnonzero(views.usable)
    known = views.geometry.F is not None or views.geometry.H is not None
    return np.arange(len(views.points_open) if known else 0)


def inliers(views: ExposureViews) -> NDArray[np.int_]:
    """Return the indices of the matches from which COLMAP may build points: none without a translation.

    A mapper takes the inliers and looks at no configuration: those of a pure rotation become points at the
    reprojection error of noise, at a depth that nothing shows.
    """
    known = len(matched(views)) and translation_known(views.geometry)
    return np.flatnonzero(views.geometry.inlier_mask if known else [])


def translation_known(geometry: TwoViewGeometry) -> bool:
    """Return whether the camera is known to have moved: parallax is proven, or the pose has a direction."""
    pose = geometry.cam2_from_cam1
    return geometry.parallax is Parallax.PROVEN or (pose is not None and bool(pose.translation.any()))
