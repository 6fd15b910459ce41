"""Rows of a COLMAP database: an image with its frame, keypoints, a pair of images.

Every function takes a connection inside a transaction that the caller opened and will end.
"""

from sqlite3 import Connection

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.colmap_camera import fundamental_to_colmap, homography_to_colmap, to_colmap
from blur2view.colmap.project import rig_of
from blur2view.colmap.schema import CAMERA_SENSOR, insertion, matches_blob, matrix_blob, pair_id, quaternion
from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry


def add_image(database: Connection, name: str, camera_id: int, *, with_frame: bool) -> int:
    """Insert an image, and a frame of its own unless the project has none; return its id."""
    image_id = _insert(database, "images", name=name, camera_id=camera_id)
    if with_frame:
        _add_frame(database, image_id, camera_id)
    return image_id


def set_camera(database: Connection, image_id: int, camera_id: int, *, with_frame: bool) -> None:
    """Give an image that is there this camera, and a frame if it has none of it."""
    database.execute("UPDATE images SET camera_id = ? WHERE image_id = ?", (camera_id, image_id))
    sql = (
        "SELECT 1 FROM frame_data JOIN frames USING (frame_id) "
        "WHERE data_id = ? AND sensor_id = ? AND sensor_type = ?"
    )
    row = (image_id, camera_id, CAMERA_SENSOR)
    if with_frame and not database.execute(sql, row).fetchone():
        own = "FROM frame_data WHERE data_id = ? AND sensor_type = ?"
        old = database.execute(f"SELECT frame_id {own}", (image_id, CAMERA_SENSOR)).fetchall()
        database.execute(f"DELETE {own}", (image_id, CAMERA_SENSOR))
        unused = "frame_id = ? AND frame_id NOT IN (SELECT frame_id FROM frame_data)"
        database.executemany(f"DELETE FROM frames WHERE {unused}", old)
        _add_frame(database, image_id, camera_id)


def _add_frame(database: Connection, image_id: int, camera_id: int) -> None:
    frame_id = _insert(database, "frames", rig_id=rig_of(database, camera_id))
    sensor = {"sensor_id": camera_id, "sensor_type": CAMERA_SENSOR}
    _insert(database, "frame_data", frame_id=frame_id, data_id=image_id, **sensor)


def put_keypoints(database: Connection, image_id: int, points: Array) -> None:
    """Write our pixels (N, 2) as the keypoints of a view, in place of those it had."""
    database.execute("DELETE FROM keypoints WHERE image_id = ?", (image_id,))
    data = np.ascontiguousarray(to_colmap(points), "<f4").tobytes()
    _insert(database, "keypoints", image_id=image_id, rows=len(points), cols=2, data=data)


def put_pair(
    database: Connection,
    ids: tuple[int, int],
    geometry: TwoViewGeometry,
    matched: NDArray[np.int_],
    inliers: NDArray[np.int_],
) -> None:
    """Write both match tables' rows of a pair with a view, in place of those it had.

    Keypoints of the indices ``matched`` are matched, those of ``inliers`` fit the geometry, whose own masks
    are not used; it leads from the first image to the second, the row from the smaller id.
    """
    geometry = geometry if ids[0] < ids[1] else geometry.reversed()
    key, pose = pair_id(*ids), geometry.cam2_from_cam1
    for table in ("matches", "two_view_geometries"):
        database.execute(f"DELETE FROM {table} WHERE pair_id = ?", (key,))
    _insert(database, "matches", pair_id=key, rows=len(matched), cols=2, data=matches_blob(matched))
    _insert(
        database,
        "two_view_geometries",
        pair_id=key,
        rows=len(inliers),
        cols=2,
        data=matches_blob(inliers),
        config=list(Configuration).index(geometry.config),
        F=matrix_blob(None if geometry.F is None else fundamental_to_colmap(geometry.F)),
        E=matrix_blob(geometry.E_of_pose),
        H=matrix_blob(None if geometry.H is None else homography_to_colmap(geometry.H)),
        qvec=matrix_blob(None if pose is None else quaternion(pose.rotation)),
        tvec=matrix_blob(None if pose is None else pose.translation),
    )


def _insert(database: Connection, table: str, **row: object) -> int:
    """Insert a row; return its id."""
    number = database.execute(insertion(table, row), tuple(row.values())).lastrowid
    if number is None:
        raise RuntimeError(f"SQLite gave no id to a row of {table}")
    return number
