"""Both virtual images of blurred photographs in a COLMAP database: a fresh one, written by pycolmap."""

import os
import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.camera import Camera, colmap_camera, to_colmap
from blur2view.colmap.project import LOGS, MAX_IMAGES, PUT_VIEW, ensure_table, open_read_only, storable
from blur2view.errors import DatabaseError
from blur2view.exposure.views import ExposureViews
from blur2view.files import write_files
from blur2view.geometry.two_view_geometry import Parallax, TwoViewGeometry
from blur2view.two_view.constants import GUESSED_FOCAL

# A row that is not of views, and of matches that are not of one photograph's both views.
NO_VIEWS = f"""
WITH pairs AS (SELECT {MAX_IMAGES} * min(image_id) + max(image_id) FROM blur2view_views
  GROUP BY photograph HAVING count(*) = 2)
SELECT 1 FROM images WHERE image_id NOT IN (SELECT image_id FROM blur2view_views)
UNION ALL SELECT 1 FROM descriptors
UNION ALL SELECT 1 FROM matches WHERE pair_id NOT IN pairs
UNION ALL SELECT 1 FROM two_view_geometries WHERE pair_id NOT IN pairs
LIMIT 1"""

Pair = tuple[int, int]


def write_database(
    path: str | os.PathLike[str], photographs: Sequence[ExposureViews], *, replace: bool = False
) -> None:
    """Write a database that holds nothing but these views; it appears whole or not at all.

    Without F and H nothing is matched. DatabaseError if the file exists, without ``replace``, or cannot be
    written; ValueError if two photographs have one name, or a name is no UTF-8.
    """
    names, path = [views.name for views in photographs], Path(path)
    if len(set(names)) != len(names) or not all(map(storable, names)):
        raise ValueError(f"photographs must have different names, all of them UTF-8, got {names}")
    refuse_existing(path, replace=replace)
    try:
        content = _views_alone(photographs)
        refuse_existing(path, replace=replace)  # may have come meanwhile
        target = path.resolve()  # a link stays one
        write_files({target: content})
    except (sqlite3.Error, OSError, RuntimeError) as error:  # RuntimeError: of pycolmap
        why = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise DatabaseError(f"{path}: cannot be written ({why}); choose another --db") from None


def _views_alone(photographs: Sequence[ExposureViews]) -> bytes:
    """Return the content of a database of views."""
    import pycolmap

    cameras: list[Any] = []
    ids: list[Pair] = []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "rows.db"
        with pycolmap.Database.open(path) as opened, pycolmap.DatabaseTransaction(opened):
            for views in photographs:
                camera = colmap_camera_of(views.camera, views.size)
                if camera not in cameras:
                    cameras.append(camera)
                    rig = pycolmap.Rig()
                    number = opened.write_camera(camera)
                    rig.add_ref_sensor(pycolmap.sensor_t(type=pycolmap.SensorType.CAMERA, id=number))
                    opened.write_rig(rig)
                first, last = (_write_image(opened, name, 1 + cameras.index(camera)) for name in views.names)
                ids.append((first, last))
                # COLMAP's mapper looks at no configuration: it would make points from a pure rotation
                known = len(matched(views)) > 0 and translation_known(views.geometry)
                inliers = views.geometry.inlier_mask & known
                write_rows(opened, views, ids[-1], {ids[-1]: replace(views.geometry, inlier_mask=inliers)})
        with closing(sqlite3.connect(path, isolation_level=None)) as database:
            database.execute("PRAGMA journal_mode = DELETE")  # no write-ahead log comes along
            database.execute("BEGIN")
            ensure_table(database)
            for views, pair in zip(photographs, ids, strict=True):
                put_views(database, views, pair)
            database.execute("COMMIT")
        return path.read_bytes()


def _write_image(opened: Any, name: str, camera_id: int) -> int:
    """Write an image of a camera, whose rig has its id, with a frame of its own; return its id."""
    import pycolmap

    image = pycolmap.Image(name=name, camera_id=camera_id)
    image.image_id = opened.write_image(image)
    frame = pycolmap.Frame(rig_id=camera_id)
    frame.add_data_id(image.data_id)
    opened.write_frame(frame)
    return int(image.image_id)


def write_rows(opened: Any, views: ExposureViews, ids: Pair, pairs: Mapping[Pair, TwoViewGeometry]) -> None:
    """Write keypoints of both images, and usable matches and geometry of pairs, into a pycolmap.Database."""
    for image_id, points in zip(ids, (views.points_open, views.points_close), strict=True):
        opened.write_keypoints(image_id, to_colmap(points).astype(np.float32))
    matches = np.stack([matched(views)] * 2, axis=1).astype(np.uint32)
    for pair, geometry in pairs.items():
        opened.write_matches(*pair, matches)
        opened.write_two_view_geometry(*pair, geometry.to_pycolmap())


def put_views(database: sqlite3.Connection, views: ExposureViews, ids: Pair) -> None:
    """List both images of a photograph in the table ``blur2view_views``."""
    known = views.geometry.config.name, int(views.time.known), views.time.confidence, views.smear_px
    for image_id, role in zip(ids, ("open", "close"), strict=True):
        database.execute(PUT_VIEW, (image_id, views.name, role, *known))


def colmap_camera_of(camera: Camera | None, size: tuple[int, int]) -> Any:
    """Return the pycolmap.Camera of a photograph (width, height): a hint is a prior, a guess is not."""
    stated = camera or Camera.from_focal(GUESSED_FOCAL * max(size), size)
    model, params = stated.model, stated.params
    if camera is None or not camera.known:
        model, params = "SIMPLE_RADIAL", (stated.focal_px, *to_colmap(stated.K[:2, 2]).tolist(), 0.0)
    stored = colmap_camera(model, *size, params)
    stored.has_prior_focal_length = camera is not None
    return stored


def refuse_existing(path: Path, *, replace: bool = False) -> None:
    """Raise a DatabaseError of what is not to be replaced, or of a log that SQLite would apply to it."""
    if os.path.lexists(path) and not replace:
        raise DatabaseError(f"{path}: exists; choose another --db, or add to a project of yours with --link")
    for log in (Path(f"{path.resolve()}{suffix}") for suffix in LOGS):
        if os.path.lexists(log):
            why = "of a program that uses the database or was killed; close it, or open it once with COLMAP"
            raise DatabaseError(f"{log}: is {why}; remove it if its database is gone")


def holds_views_alone(path: Path) -> bool:
    """Return whether a file is a database that holds nothing but views of photographs."""
    try:
        with open_read_only(path) as database:
            return database.execute(NO_VIEWS).fetchone() is None
    except DatabaseError:
        return False


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
