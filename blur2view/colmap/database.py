"""Both virtual images of blurred photographs in a COLMAP database: their rows, and a fresh database."""

import os
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.camera.camera import Camera
from blur2view.camera.colmap_camera import colmap_camera, to_colmap
from blur2view.colmap.connection import LOGS, connect, database_errors, open_read_only
from blur2view.colmap.project import ProjectImage, has_frames, own_views
from blur2view.colmap.schema import CAMERA_SENSOR, MAX_IMAGES, VIEWS_TABLE, put_image, put_row
from blur2view.errors import DatabaseError
from blur2view.exposure.end_order import GUESSED_FOCAL
from blur2view.exposure.half_exposure import half_geometry
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.two_view_geometry import Parallax, TwoViewGeometry
from blur2view.output_files import remove_half_written, write_files

# A row that is not of views, and of matches that are not of one photograph's both views.
NO_VIEWS = f"""
WITH pairs AS (SELECT {MAX_IMAGES} * min(image_id) + max(image_id) FROM blur2view_views
  GROUP BY photograph HAVING count(*) = 2)
SELECT 1 FROM images WHERE image_id NOT IN (SELECT image_id FROM blur2view_views)
UNION ALL SELECT 1 FROM descriptors
UNION ALL SELECT 1 FROM matches WHERE pair_id NOT IN pairs
UNION ALL SELECT 1 FROM two_view_geometries WHERE pair_id NOT IN pairs
LIMIT 1"""

COLUMNS = {  # what pycolmap writes and every version of COLMAP's database has
    "keypoints": "image_id, rows, cols, data",
    "matches": "pair_id, rows, cols, data",
    "two_view_geometries": "pair_id, rows, cols, data, config, F, E, H, qvec, tvec",
}


def write_database(
    path: str | os.PathLike[str], photographs: Sequence[ExposureViews], *, replace: bool = False
) -> None:
    """Write a database that holds nothing but these views; it appears whole or not at all.

    Photographs with equal cameras share one. Without F and H nothing is matched. The table
    ``blur2view_views`` says whether time directions are known. With ``replace`` an earlier file is replaced.
    DatabaseError if the file exists or cannot be written; ValueError if two photographs have one name.
    """
    names, path = [views.name for views in photographs], Path(path)
    if len(set(names)) != len(names):
        raise ValueError(f"photographs must have different names, got {names}")
    if not replace:
        refuse_existing(path)
    try:
        content = _views_alone(photographs)
        if replace and path.is_file():
            # settle its log or journal, or SQLite would apply it to what takes its place; it may be in use
            with database_errors(path), closing(connect(path, "mode=rw")) as old:
                old.execute("PRAGMA journal_mode = DELETE")
                old.execute("SELECT 1 FROM sqlite_master")
        else:
            refuse_existing(path)  # may have come meanwhile
        remove_half_written(path.parent)
        write_files({path: content})
    except (sqlite3.Error, OSError, RuntimeError) as error:  # RuntimeError: of pycolmap
        why = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise DatabaseError(f"{path}: cannot be written ({why}); choose another --db") from None


def _views_alone(photographs: Sequence[ExposureViews]) -> bytes:
    """Return the content of a database of views."""
    import pycolmap

    cameras: list[Any] = []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "new.db"
        stored = [colmap_camera_of(views.camera, views.size) for views in photographs]
        with pycolmap.Database.open(path) as opened:
            for camera in stored:
                if camera not in cameras:
                    opened.write_camera(camera)
                    cameras.append(camera)
        ids = [1 + cameras.index(camera) for camera in stored]
        with closing(sqlite3.connect(path, isolation_level=None)) as database:
            database.execute("PRAGMA journal_mode = DELETE")  # no write-ahead log comes along
            database.executescript(f"BEGIN; {VIEWS_TABLE}")
            for number in range(1, len(cameras) + 1):
                put_row(database, "rigs", ref_sensor_id=number, ref_sensor_type=CAMERA_SENSOR)
            put_views(database, [(one, number, None) for one, number in zip(photographs, ids, strict=True)])
            database.execute("COMMIT")
        return path.read_bytes()


def put_views(
    database: sqlite3.Connection, photographs: Iterable[tuple[ExposureViews, int, ProjectImage | None]]
) -> None:
    """Write both images of photographs, of cameras with these ids, and their pairs, in place of earlier ones.

    Of a photograph of a project also its pairs with both. pycolmap makes keypoints, matches and geometries in
    a file of its own.
    """
    import pycolmap

    any_camera = pycolmap.Camera(model="PINHOLE", width=1, height=1, params=[1, 1, 0, 0])
    with TemporaryDirectory() as folder:
        path = Path(folder) / "rows.db"
        with pycolmap.Database.open(path) as opened, pycolmap.DatabaseTransaction(opened):
            opened.write_camera(any_camera)
            for views, camera_id, photograph in photographs:
                ids = _put_images(database, views, camera_id, photograph)
                for image_id, points in zip(ids, (views.points_open, views.points_close), strict=True):
                    image = pycolmap.Image(name=f"{image_id}", camera_id=1, image_id=image_id)
                    opened.write_image(image, use_image_id=True)
                    opened.write_keypoints(image_id, to_colmap(points).astype(np.float32))
                matches = np.stack([matched(views)] * 2, axis=1).astype(np.uint32)
                for pair, geometry in _pairs(views, ids, photograph).items():
                    opened.write_matches(*pair, matches)
                    opened.write_two_view_geometry(*pair, geometry.to_pycolmap())
        with closing(sqlite3.connect(path)) as rows:
            rows.row_factory = sqlite3.Row
            for table, columns in COLUMNS.items():
                for row in rows.execute(f"SELECT {columns} FROM {table}"):
                    put_row(database, table, **dict(row))


def _put_images(
    database: sqlite3.Connection, views: ExposureViews, camera_id: int, photograph: ProjectImage | None
) -> tuple[int, int]:
    """Write the images of both views and what is known of them; return their ids."""
    own = {} if photograph is None else own_views(database, photograph.name)
    with_frame = photograph is None or has_frames(database)
    known = {
        "photograph": views.name,
        "config": views.geometry.config.name,
        "time_known": int(views.time.known),
        "time_confidence": views.time.confidence,
        "source": None if photograph is None else photograph.digest,
    }
    ids = []
    for role, name in zip(("open", "close"), views.names, strict=True):
        image_id = own[role][0] if role in own else None
        ids.append(put_image(database, name, camera_id, image_id, with_frame=with_frame))
        put_row(database, "blur2view_views", image_id=ids[-1], role=role, **known)
    return ids[0], ids[1]


def _pairs(
    views: ExposureViews, ids: tuple[int, int], photograph: ProjectImage | None
) -> dict[tuple[int, int], TwoViewGeometry]:
    """Return the geometries by pairs of images, with the inliers that COLMAP may make points from.

    Without a project that is none unless the translation is known: a mapper looks at no configuration, and
    would make points of a pure rotation, at a depth that nothing shows.
    """
    whole = views.geometry
    if photograph is None:
        known = len(matched(views)) > 0 and translation_known(whole)
        return {ids: replace(whole, inlier_mask=whole.inlier_mask & known)}
    halves = {
        (photograph.image_id, end): half_geometry(geometry, views.camera, views.size)
        for end, geometry in zip(ids, (whole.reversed(), whole), strict=True)
    }
    return {ids: whole, **halves}


def colmap_camera_of(camera: Camera | None, size: tuple[int, int]) -> Any:
    """Return the pycolmap.Camera of a photograph, whose width and height are ``size``, pixels.

    Known intrinsics are written as they are. A hint keeps its focal length as a prior and gets room for a
    distortion; without any camera the same holds of COLMAP's own guess, which is no prior.
    """
    stated = camera or Camera.from_focal(GUESSED_FOCAL * max(size), size)
    model, params = stated.model, stated.params
    if camera is None or not camera.known:
        model, params = "SIMPLE_RADIAL", (stated.focal_px, *to_colmap(stated.K[:2, 2]).tolist(), 0.0)
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


def written_photographs(path: Path) -> set[str] | None:
    """Return the photographs of a database of ours that holds nothing but their views; None of another."""
    try:
        with open_read_only(path) as database:
            if database.execute(NO_VIEWS).fetchone() is None:
                return {str(name) for (name,) in database.execute("SELECT photograph FROM blur2view_views")}
    except DatabaseError:
        pass
    return None


def matched(views: ExposureViews) -> NDArray[np.int_]:
    """Return the indices of the usable points if their order is known up to time reversal, else of none."""
    if views.usable is not None:
        return np.flatnonzero(views.usable)
    known = views.geometry.F is not None or views.geometry.H is not None
    return np.arange(len(views.points_open) if known else 0)


def translation_known(geometry: TwoViewGeometry) -> bool:
    """Return whether the camera is known to have moved: parallax is proven, or the pose has a direction."""
    pose = geometry.cam2_from_cam1
    return geometry.parallax is Parallax.PROVEN or (pose is not None and bool(pose.translation.any()))
