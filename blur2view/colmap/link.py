"""Virtual views added to a COLMAP project that holds the photographs and their features.

Per photograph two images, their keypoints, and three pairs: photograph-open, photograph-close, open-close.
Rows of the user are read, never written: views go in by plain INSERT, which no row can be lost to. Views that
an earlier call wrote are written anew.
"""

import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from datetime import datetime
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera import Camera, from_colmap
from blur2view.colmap.database import Pair, put_views, write_rows
from blur2view.colmap.project import (
    CAMERA_SENSOR,
    check_schema,
    connect,
    ensure_table,
    has_frames,
    image_names,
    longest_suffix,
    open_for_writing,
    open_read_only,
    own_views,
    pair_id,
    read_keypoints,
    rig_of,
)
from blur2view.errors import DatabaseError
from blur2view.exposure.views import CLOSE, OPEN, ExposureViews
from blur2view.files import half_written
from blur2view.geometry.epipolar import cross_matrix, fundamental_from_pose, symmetric_skew, unit_norm
from blur2view.geometry.pose import RigidTransform, rotation_matrix
from blur2view.geometry.two_view_geometry import TwoViewGeometry

COLUMNS = {  # what pycolmap writes of views, and every version of COLMAP's database has
    "keypoints": "image_id, rows, cols, data",
    "matches": "pair_id, rows, cols, data",
    "two_view_geometries": "pair_id, rows, cols, data, config, F, E, H, qvec, tvec",
}


class ProjectImage(NamedTuple):
    """One image of a project, as it was read."""

    image_id: int
    camera_id: int
    name: str
    prior_focal: bool  # whether the project takes the camera's focal length for more than a guess
    keypoints: NDArray[np.float64]  # our pixels (N, 2)
    stored: tuple[Any, ...]  # the rows of its camera and its keypoints, to notice a change
    linked: bool  # whether an earlier call has written its views


def plan_links(path: Path, photographs: Sequence[Path]) -> list[ProjectImage | DatabaseError]:
    """Return the image of each photograph of a project, or why it cannot be linked; nothing is written."""
    plan: list[ProjectImage | DatabaseError] = []
    first_of: dict[str, Path] = {}
    with open_read_only(path) as database:
        check_schema(database)
        names = image_names(database)
        for photograph in photographs:
            name = longest_suffix(names, photograph)
            if name is None:
                remedy = "leave it out, or choose another --db, without --link"
                plan.append(DatabaseError(f"{photograph}: {path} has no image of that name; {remedy}"))
            elif name in first_of:
                plan.append(DatabaseError(f"{photograph}: is {name}, as is {first_of[name]}; name it once"))
            else:
                first_of[name] = photograph
                try:
                    plan.append(_read_image(database, names, name))
                except ValueError as error:
                    plan.append(DatabaseError(f"{path}: {error}"))
    return plan


def _read_image(database: sqlite3.Connection, names: Mapping[str, int], name: str) -> ProjectImage:
    """Return one image of the project; ValueError where it cannot be linked."""
    sql = (
        "SELECT image_id, camera_id, prior_focal_length, model, width, height, params, data FROM images "
        "LEFT JOIN cameras USING (camera_id) LEFT JOIN keypoints USING (image_id) WHERE name = ?"
    )
    image_id, *stored = database.execute(sql, (name,)).fetchone()
    camera_id, prior, own = stored[0], stored[1], own_views(database, name)
    keypoints = from_colmap(read_keypoints(database, image_id))
    if not len(keypoints):
        raise ValueError(f"image {name} has no keypoints; run COLMAP's feature extraction first")
    if prior is None or (has_frames(database) and rig_of(database, camera_id) is None):
        raise ValueError(f"image {name} has no camera, or its camera has no rig; the database is damaged")
    for view in (name + OPEN, name + CLOSE):
        if view in names and names[view] not in own.values():
            raise ValueError(f"holds an image {view} that blur2view did not write; rename or delete it")
    return ProjectImage(image_id, camera_id, name, bool(prior), keypoints, tuple(stored), bool(own))


def write_links(
    path: Path, links: Sequence[tuple[ProjectImage, ExposureViews]], *, backup: bool = True
) -> Path | None:
    """Write planned views in one transaction, and return the backup that ``backup`` makes before.

    DatabaseError, and nothing is written, if it cannot be used or an image changed since the plan.
    """
    if not links:
        return None
    with ExitStack() as undo:
        with open_for_writing(path) as database:
            check_schema(database)
            names = image_names(database)
            for image, _ in links:
                now = _read_image(database, names, image.name) if image.name in names else None
                if now is None or (now.image_id, now.stored) != (image.image_id, image.stored):
                    raise ValueError(f"image {image.name} has changed meanwhile; run again")
            copy = back_up(path) if backup else None
            if copy is not None:
                undo.callback(copy.unlink)  # it equals the database if that stays as it was
            ensure_table(database)
            _put_all(database, links)
        undo.pop_all()
    return copy


def _put_all(database: sqlite3.Connection, links: Sequence[tuple[ProjectImage, ExposureViews]]) -> None:
    """Write the views of photographs: pycolmap makes keypoints, matches and geometries in a file beside."""
    import pycolmap

    any_camera = pycolmap.Camera(model="PINHOLE", width=1, height=1, params=[1, 1, 0, 0])
    with TemporaryDirectory() as folder:
        beside = Path(folder) / "rows.db"
        with pycolmap.Database.open(beside) as opened, pycolmap.DatabaseTransaction(opened):
            opened.write_camera(any_camera)
            for image, views in links:
                ids = _put_images(database, image)
                put_views(database, views, ids)
                for image_id in ids:
                    view = pycolmap.Image(name=f"{image_id}", camera_id=1, image_id=image_id)
                    opened.write_image(view, use_image_id=True)
                halves = {
                    (image.image_id, end): half_geometry(geometry, views.camera, views.size)
                    for end, geometry in zip(ids, (views.geometry.reversed(), views.geometry), strict=True)
                }
                write_rows(opened, views, ids, {ids: views.geometry, **halves})
        with closing(sqlite3.connect(beside)) as rows:
            for table, columns in COLUMNS.items():
                sql = f"INSERT INTO {table}({columns}) VALUES ({', '.join('?' * len(columns.split()))})"
                database.executemany(sql, rows.execute(f"SELECT {columns} FROM {table}"))


def _put_images(database: sqlite3.Connection, image: ProjectImage) -> Pair:
    """Write the images of both views in place of earlier ones, with frames if others have; return the ids."""
    own = own_views(database, image.name)
    with_frames, of_frame = has_frames(database), f"data_id = ? AND sensor_type = {CAMERA_SENSOR}"
    doomed = ["keypoints WHERE image_id = ?", "images WHERE image_id = ?"]
    if with_frames:
        frames = f"frames WHERE frame_id IN (SELECT frame_id FROM frame_data WHERE {of_frame})"
        doomed = [frames, f"frame_data WHERE {of_frame}", *doomed]
    for rows in doomed:
        database.executemany(f"DELETE FROM {rows}", [(number,) for number in own.values()])
    for pair in combinations([image.image_id, *own.values()], 2):
        for table in ("matches", "two_view_geometries"):
            database.execute(f"DELETE FROM {table} WHERE pair_id = ?", (pair_id(*pair),))
    ids = []
    for role, ending in (("open", OPEN), ("close", CLOSE)):
        row = {"image_id": own.get(role), "name": image.name + ending, "camera_id": image.camera_id}
        ids.append(_insert(database, "images", row))
        if with_frames:
            frame = {"frame_id": None, "rig_id": rig_of(database, image.camera_id)}
            sensor = {"sensor_id": image.camera_id, "sensor_type": CAMERA_SENSOR}
            data = {"frame_id": _insert(database, "frames", frame), "data_id": ids[-1]}
            _insert(database, "frame_data", data | sensor)
    return ids[0], ids[1]


def _insert(database: sqlite3.Connection, table: str, row: Mapping[str, object]) -> int:
    """Insert a row and return its id."""
    sql = f"INSERT INTO {table}({', '.join(row)}) VALUES ({', '.join('?' * len(row))})"
    return int(database.execute(sql, tuple(row.values())).lastrowid or 0)


def back_up(path: Path) -> Path:
    """Copy a database, as its last transaction left it, to ``<name>.<time>.bak`` beside it."""
    copy = path.with_name(f"{path.name}.{datetime.now():%Y%m%dT%H%M%S.%f}.bak")
    beside = half_written(path)
    beside.unlink(missing_ok=True)  # of a call that was killed
    try:
        # not `open_read_only`, whose look at the header would end the lock of this process's transaction
        with closing(connect(path, "mode=ro")) as source, closing(sqlite3.connect(beside)) as target:
            target.execute("PRAGMA journal_mode = MEMORY")  # a half-written file is thrown away
            source.backup(target)
        beside.replace(copy)
    except (sqlite3.Error, OSError) as error:
        raise DatabaseError(f"{copy}: the backup cannot be written ({error}); add --no-backup") from None
    finally:
        beside.unlink(missing_ok=True)
    return copy


def half_geometry(geometry: TwoViewGeometry, camera: Camera | None, size: tuple[int, int]) -> TwoViewGeometry:
    """Return the geometry from mid-exposure (1) to close (2), of that from open to close; without H.

    The camera is taken to move as one screw motion, and a photograph's features to lie in the middle of
    their smears. With a camera F is exactly that of the halved pose. ``size`` is width and height, pixels.
    """
    whole = geometry.cam2_from_cam1
    pose = None if whole is None else half_pose(whole)
    F = None if geometry.F is None else half_fundamental(geometry.F, size)
    if pose is not None and pose.translation.any() and camera is not None and F is not None:
        F = fundamental_from_pose(camera.K, pose.rotation, pose.translation)
    return replace(geometry, F=F, H=None, cam2_from_cam1=pose, covariance=None)


def half_pose(pose: RigidTransform) -> RigidTransform:
    """Return the pose, of unit translation, that applied twice is this one: of R^2 and (R + I) t."""
    R = rotation_matrix(0.5 * pose.rotation_vector)
    t = np.asarray(np.linalg.solve(R + np.eye(3), pose.translation), np.float64)
    return RigidTransform(rotation=R, translation=t / max(float(np.linalg.norm(t)), 1e-30))


def half_fundamental(F: Array, size: tuple[int, int]) -> Array:
    """Return F (3, 3) of half the motion, to first order in the motion; of unit norm and rank 2.

    A smear d about p satisfies p^T S p + a . (d x p) = 0 up to second order, F = S + [a]x; d/2 satisfies
    that of S / 2 + [a]x. The nearest of rank 2, where the picture is of unit size.
    """
    scale = 2.0 / max(size)
    T = np.diag([scale, scale, 1.0])
    T[:2, 2] = -scale * (np.array(size, float) - 1) / 2
    back = np.linalg.inv(T)
    S, a = symmetric_skew(back.T @ F @ back)
    U, singular, Vt = np.linalg.svd(0.5 * S + cross_matrix(a))
    return unit_norm(T.T @ (U * [singular[0], singular[1], 0.0]) @ Vt @ T)
