"""Both virtual images of blurred photographs in COLMAP's databases: in a fresh one, or in a user's project.

A fresh database holds nothing else. A project holds the photographs and their features; to each photograph it
gets two images, their keypoints, and three pairs: photograph-open, photograph-close, open-close. The user's
rows are read, never written: views go in by plain INSERT, which no row can be lost to. Views that an earlier
call wrote are written anew. Keypoints, matches and geometries are made by pycolmap.
"""

import os
import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from datetime import datetime
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blur2view.camera import Camera, colmap_camera, from_colmap, to_colmap
from blur2view.colmap import project
from blur2view.errors import DatabaseError
from blur2view.exposure.views import CLOSE, OPEN, ExposureViews, half_geometry
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.output import half_written, write_files

GUESSED_FOCAL = 1.2  # of the longer side, as COLMAP guesses
# Whether every image is a view, and no other pairs are matched than both views of a photograph.
VIEWS_ALONE = """
SELECT NOT EXISTS (SELECT 1 FROM images WHERE image_id NOT IN (SELECT image_id FROM blur2view_views))
  AND (SELECT count(*) FROM matches) <= (SELECT count(DISTINCT photograph) FROM blur2view_views)"""
COLUMNS = {  # of views, as pycolmap writes them; those that every version of COLMAP's database has
    "keypoints": "image_id, rows, cols, data",
    "matches": "pair_id, rows, cols, data",
    "two_view_geometries": "pair_id, rows, cols, data, config, F, E, H, qvec, tvec",
}

Pair = tuple[int, int]
Placed = tuple[ExposureViews, int, int | None]
"""Views, the id of their camera, and the id of the photograph's image, None in a fresh database."""


def write_database(path: str | os.PathLike[str], photographs: Sequence[ExposureViews]) -> None:
    """Write a database that holds nothing but these views; it appears whole or not at all.

    Without F and H nothing is matched. A database of nothing but views is replaced.

    Parameters
    ----------
    path : path
        The database.
    photographs : sequence of ExposureViews
        The views of each photograph, of `views_of`.

    Returns
    -------
    None

    Raises
    ------
    DatabaseError
        If any other file is there, or the database cannot be written.
    ValueError
        If photographs share a name, or one is not UTF-8.

    Examples
    --------
    >>> import blur2view
    >>> from blur2view import views_of, write_database
    >>> write_database("new.db", [views_of("sample.jpg", blur2view.estimate("models/sample.jpg"))])
    """
    path, names = Path(path), [views.name for views in photographs]
    if len(set(names)) < len(names) or not all(map(project.storable, names)):
        raise ValueError(f"photographs must have different names, all of them UTF-8, got {names}")
    check_target(path)
    try:
        content = _views_alone(photographs)
        check_target(path)  # one may have come meanwhile
        write_files({path: content})
    except (sqlite3.Error, OSError, RuntimeError) as error:  # RuntimeError: of pycolmap
        why = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise DatabaseError(f"{path}: cannot be written ({why}); choose another --db") from None


def check_target(path: Path) -> None:
    """Raise DatabaseError if a file holds more than views, or SQLite would apply a log beside it."""
    for log in (Path(f"{os.path.realpath(path)}{suffix}") for suffix in project.LOGS):
        if os.path.lexists(log):
            why = "a log that SQLite would apply; close the program that uses it, or open it once with COLMAP"
            raise DatabaseError(f"{log}: is {why}; remove it if its database is gone")
    alone = not os.path.lexists(path)
    with suppress(DatabaseError), project.open_read_only(path) as database:
        alone = database.execute(VIEWS_ALONE).fetchone()[0]
    if not alone:
        raise DatabaseError(
            f"{path}: already exists; choose another --db, or add to your project with --link"
        )


def _views_alone(photographs: Sequence[ExposureViews]) -> bytes:
    """Return the content of a database of views."""
    import pycolmap

    cameras: list[Any] = []
    placed: list[Placed] = []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "new.db"
        with pycolmap.Database.open(path) as opened:
            for views in photographs:
                camera = to_colmap_camera(views.camera, views.size)
                if camera not in cameras:
                    cameras.append(camera)
                    rig, number = pycolmap.Rig(), opened.write_camera(camera)
                    rig.add_ref_sensor(pycolmap.sensor_t(type=pycolmap.SensorType.CAMERA, id=number))
                    opened.write_rig(rig)
                placed.append((views, 1 + cameras.index(camera), None))
        with closing(project.connect(path, "mode=rw")) as database:
            database.execute("PRAGMA journal_mode = DELETE")  # no write-ahead log comes along
            database.execute("BEGIN")
            _put_views(database, placed)
            database.execute("COMMIT")
        return path.read_bytes()


def to_colmap_camera(camera: Camera | None, size: tuple[int, int]) -> Any:
    """Return the pycolmap.Camera of a photograph (width, height); a hint is a prior, a guess is not."""
    stated = camera or Camera.from_focal(GUESSED_FOCAL * max(size), size)
    model, params = stated.model, stated.params
    if camera is None or not camera.known:
        model, params = "SIMPLE_RADIAL", (stated.focal_px, *to_colmap(stated.K[:2, 2]).tolist(), 0.0)
    stored = colmap_camera(model, *size, params)
    stored.has_prior_focal_length = camera is not None
    return stored


class ProjectImage(NamedTuple):
    """One image of a project, as it was read."""

    image_id: int
    camera_id: int
    name: str
    camera: Camera
    prior_focal: bool  # COLMAP's prior_focal_length of its camera
    keypoints: NDArray[np.float64]  # our pixels (N, 2)
    linked: bool  # whether an earlier call has written its views


def plan_links(path: Path, photographs: Sequence[Path]) -> list[ProjectImage | DatabaseError]:
    """Return each photograph's image in a project, or why it cannot be linked; nothing is written."""
    plan: list[ProjectImage | DatabaseError] = []
    photograph_by_image: dict[str, Path] = {}
    with project.open_read_only(path) as database:
        project.check_schema(database)
        names = project.image_names(database)
        for photograph in photographs:
            name = project.longest_suffix(names, photograph)
            if name is None:
                remedy = "leave it out, or choose another --db, without --link"
                plan.append(DatabaseError(f"{photograph}: {path} has no image of that name; {remedy}"))
            elif name in photograph_by_image:
                plan.append(
                    DatabaseError(
                        f"{photograph}: is the image {name}, and so is {photograph_by_image[name]}; "
                        f"name only one of them"
                    )
                )
            else:
                photograph_by_image[name] = photograph
                try:
                    plan.append(_read_image(database, names, name))
                except ValueError as error:
                    plan.append(DatabaseError(f"{path}: {error}"))
    return plan


def _read_image(database: sqlite3.Connection, names: Mapping[str, int], name: str) -> ProjectImage:
    """Return one image of the project; ValueError if it cannot be linked."""
    sql = (
        "SELECT image_id, camera_id, prior_focal_length FROM images LEFT JOIN cameras USING (camera_id) "
        "WHERE name = ?"
    )
    image_id, camera_id, prior = database.execute(sql, (name,)).fetchone()
    own = project.own_views(database, name)
    keypoints = from_colmap(project.read_keypoints(database, image_id))
    if not len(keypoints):
        raise ValueError(f"image {name} has no keypoints; run COLMAP's feature extraction first")
    if prior is None or (project.has_frames(database) and project.find_rig(database, camera_id) is None):
        raise ValueError(f"image {name} has no camera, or its camera has no rig; restore a backup")
    for view in (name + OPEN, name + CLOSE):
        if view in names and names[view] not in own.values():
            raise ValueError(f"holds an image {view} that blur2view did not write; rename or delete it")
    camera = project.read_camera(database, camera_id)
    return ProjectImage(image_id, camera_id, name, camera, bool(prior), keypoints, bool(own))


def write_links(path: Path, photographs: Sequence[ExposureViews], *, backup: bool = True) -> Path | None:
    """Write planned views in one transaction; return the path of the ``backup`` that is made before it.

    DatabaseError, and nothing is written, if the database cannot be used, or an image is gone or has another
    number of keypoints than its views.
    """
    placed: list[Placed] = []
    with project.open_for_writing(path) as database:
        names = project.image_names(database)
        for views in photographs:
            image = _read_image(database, names, views.name) if views.name in names else None
            if image is None or len(image.keypoints) != len(views.points_open):
                raise ValueError(
                    f"image {views.name} has changed while blur2view worked; run the command again"
                )
            placed.append((views, image.camera_id, image.image_id))
        copy = back_up(path) if backup else None
        _put_views(database, placed)
    return copy


def _put_views(database: sqlite3.Connection, placed: Sequence[Placed]) -> None:
    """Write views; pycolmap makes their keypoints, matches and geometries in a file beside the database."""
    import pycolmap

    project.ensure_table(database)
    any_camera = pycolmap.Camera(model="PINHOLE", width=1, height=1, params=[1, 1, 0, 0])
    with TemporaryDirectory() as folder:
        beside = Path(folder) / "rows.db"
        with pycolmap.Database.open(beside) as opened, pycolmap.DatabaseTransaction(opened):
            opened.write_camera(any_camera)
            for views, camera_id, image_id in placed:
                ids = _put_images(database, views, camera_id, image_id)
                for number, points in zip(ids, (views.points_open, views.points_close), strict=True):
                    view = pycolmap.Image(name=f"{number}", camera_id=1, image_id=number)
                    opened.write_image(view, use_image_id=True)
                    opened.write_keypoints(number, to_colmap(points).astype(np.float32))
                matches = np.stack([views.matched] * 2, axis=1).astype(np.uint32)
                for pair, geometry in _geometries(views, ids, image_id).items():
                    opened.write_matches(*pair, matches)
                    opened.write_two_view_geometry(*pair, geometry.to_pycolmap())
        with closing(sqlite3.connect(beside)) as rows:
            for table, columns in COLUMNS.items():
                sql = f"INSERT INTO {table}({columns}) VALUES ({', '.join('?' * len(columns.split()))})"
                database.executemany(sql, rows.execute(f"SELECT {columns} FROM {table}"))


def _geometries(views: ExposureViews, ids: Pair, image_id: int | None) -> dict[Pair, TwoViewGeometry]:
    """Return the geometries of the pairs of both views and the photograph's image, if there is one."""
    whole, camera, size = views.geometry, views.camera, views.size
    if image_id is None:
        # COLMAP's mapper looks at no configuration: it would make points from a pure rotation
        known = len(views.matched) > 0 and views.translation_known
        return {ids: replace(whole, inlier_mask=whole.inlier_mask & known)}
    ends = zip(ids, (whole.reversed(), whole), strict=True)
    halves = {(image_id, end): half_geometry(geometry, camera, size) for end, geometry in ends}
    return {ids: whole, **halves}


def _put_images(
    database: sqlite3.Connection, views: ExposureViews, camera_id: int, image_id: int | None
) -> Pair:
    """Write the images of both views in place of earlier ones, with frames if others have; return the ids."""
    own = project.own_views(database, views.name)
    with_frames = image_id is None or project.has_frames(database)
    own_frames = (
        f"SELECT frame_id FROM frame_data WHERE data_id = ? AND sensor_type = {project.CAMERA_SENSOR}"
    )
    for number in own.values():  # by foreign keys their keypoints, data of frames and entries go along
        if with_frames:
            database.execute(f"DELETE FROM frames WHERE frame_id IN ({own_frames})", (number,))
        database.execute("DELETE FROM images WHERE image_id = ?", (number,))
    for pair in combinations([image_id or 0, *own.values()], 2):
        for table in ("matches", "two_view_geometries"):
            database.execute(f"DELETE FROM {table} WHERE pair_id = ?", (project.pair_id(*pair),))
    ids, time = [], views.time
    for role, name in zip(("open", "close"), views.names, strict=True):
        row = {"image_id": own.get(role), "name": name, "camera_id": camera_id}
        ids.append(_insert(database, "images", row, below=project.MAX_IMAGES))
        if with_frames:
            rig = {"rig_id": project.find_rig(database, camera_id)}
            frame_id = _insert(database, "frames", rig, below=project.MAX_FRAMES)
            sensor = {"sensor_id": camera_id, "sensor_type": project.CAMERA_SENSOR}
            _insert(database, "frame_data", {"frame_id": frame_id, "data_id": ids[-1], **sensor})
        entry = {"image_id": ids[-1], "photograph": views.name, "role": role}
        entry |= {"config": views.geometry.config.name, "time_known": int(time.known)}
        entry |= {"time_confidence": time.confidence, "smear_px": views.smear_px}
        _insert(database, "blur2view_views", entry)
    return ids[0], ids[1]


def _insert(
    database: sqlite3.Connection, table: str, row: Mapping[str, object], *, below: int = 2**63
) -> int:
    """Insert a row and return its id; ValueError if SQLite counts on ``below`` a number that COLMAP holds."""
    sql = f"INSERT INTO {table}({', '.join(row)}) VALUES ({', '.join('?' * len(row))})"
    number = int(database.execute(sql, tuple(row.values())).lastrowid or 0)
    if not 0 <= number < below:
        raise ValueError(
            f"its {table} have numbers up to {number - 1}, which is COLMAP's limit; make a new database"
        )
    return number


def back_up(path: Path) -> Path:
    """Copy a database, as its last transaction left it, to ``<name>.<time>.bak`` beside it."""
    copy = path.with_name(f"{path.name}.{datetime.now():%Y%m%dT%H%M%S.%f}.bak")
    beside = half_written(path)
    beside.unlink(missing_ok=True)  # of a call that was killed
    try:
        # not `open_read_only`, whose look at the header would end the lock of this process's transaction
        with closing(project.connect(path, "mode=ro")) as source, closing(sqlite3.connect(beside)) as target:
            target.execute("PRAGMA journal_mode = MEMORY")  # a half-written file is thrown away
            source.backup(target)
        beside.replace(copy)
    except (sqlite3.Error, OSError) as error:
        raise DatabaseError(f"{copy}: the backup cannot be written ({error}); add --no-backup") from None
    finally:
        beside.unlink(missing_ok=True)
    return copy
