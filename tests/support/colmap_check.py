"""A check of all tables of a COLMAP database against each other, beyond what SQLite itself enforces."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from blur2view.colmap.connection import open_read_only
from blur2view.colmap.schema import CAMERA_SENSOR, MAX_IMAGES

SIZES = {"F": 72, "E": 72, "H": 72, "qvec": 32, "tvec": 24}  # bytes


def check_database(path: Path) -> list[str]:
    """Return a line for everything that is wrong with a COLMAP database, which is not written.

    SQLite's own integrity and foreign keys; an image without camera, or without frame and rig where frames
    are used; blobs whose size contradicts their row; matches that point beyond the keypoints, occur twice or
    belong to no images; inliers that are no matches; geometries with a matrix that is not finite or a
    quaternion that is not of unit length.
    """
    with open_read_only(path) as database:
        found = [f"integrity: {row[0]}" for row in database.execute("PRAGMA integrity_check")]
        if found != ["integrity: ok"]:
            return found
        broken = database.execute("PRAGMA foreign_key_check").fetchall()
        return [f"foreign key: {row}" for row in broken] + [
            *_images(database),
            *_keypoints(database),
            *_pairs(database),
        ]


def _images(database: sqlite3.Connection) -> Iterator[str]:
    """Find images whose camera, frame or rig is missing or not theirs."""
    cameras = {row[0] for row in database.execute("SELECT camera_id FROM cameras")}
    images = database.execute("SELECT image_id, name, camera_id FROM images").fetchall()
    for _, name, camera in images:
        if camera not in cameras:
            yield f"image {name}: no camera {camera}"
    tables = {row[0] for row in database.execute("SELECT name FROM sqlite_master")}
    if "frames" not in tables or not database.execute("SELECT 1 FROM frames").fetchone():
        return
    sql = (
        "SELECT data_id, sensor_id, rig_id FROM frame_data JOIN frames USING (frame_id) WHERE sensor_type = ?"
    )
    frames = {row[0]: row[1:] for row in database.execute(sql, (CAMERA_SENSOR,))}
    sql = (
        "SELECT rig_id, ref_sensor_id, ref_sensor_type FROM rigs "
        "UNION ALL SELECT rig_id, sensor_id, sensor_type FROM rig_sensors"
    )
    sensors = {(rig, sensor) for rig, sensor, kind in database.execute(sql) if kind == CAMERA_SENSOR}
    for image, name, camera in images:
        sensor, rig = frames.get(image, (None, None))
        if sensor != camera:
            yield f"image {name}: no frame of its camera {camera}"
        elif (rig, camera) not in sensors:
            yield f"image {name}: rig {rig} of its frame has no camera {camera}"


def _keypoints(database: sqlite3.Connection) -> Iterator[str]:
    for image, rows, cols, data in database.execute("SELECT image_id, rows, cols, data FROM keypoints"):
        blob = data or b""
        if cols not in (2, 4, 6) or len(blob) != 4 * rows * cols:
            yield f"keypoints of image {image}: {len(blob)} bytes for {rows} x {cols}"
        elif not np.isfinite(np.frombuffer(blob, "<f4")).all():
            yield f"keypoints of image {image}: not finite"


def _pairs(database: sqlite3.Connection) -> Iterator[str]:
    """Find matches and geometries that fit neither each other nor the keypoints."""
    counts = dict(database.execute("SELECT image_id, rows FROM keypoints"))
    matches: dict[int, set[tuple[int, int]]] = {}
    for table in ("matches", "two_view_geometries"):
        for pair, rows, cols, data in database.execute(f"SELECT pair_id, rows, cols, data FROM {table}"):
            image1, image2 = ids = divmod(pair, MAX_IMAGES)
            where = f"{table} {ids}"
            if image1 not in counts or image2 not in counts or image1 >= image2:
                yield f"{where}: no such images"
                continue
            blob = data or b""
            if cols != 2 or len(blob) != 8 * rows:
                yield f"{where}: {len(blob)} bytes for {rows} x {cols}"
                continue
            indices = np.frombuffer(blob, "<u4").reshape(-1, 2)
            if len(indices) and (indices.max(axis=0) >= [counts[image1], counts[image2]]).any():
                yield f"{where}: beyond the keypoints"
            listed = {(int(one), int(other)) for one, other in indices}
            if len(listed) != len(indices):
                yield f"{where}: a match occurs twice"
            if table == "matches":
                matches[pair] = listed
            elif not listed <= matches.get(pair, set()):
                yield f"{where}: inliers that are no matches"
    yield from _geometries(database)


def _geometries(database: sqlite3.Connection) -> Iterator[str]:
    """Find matrices of another size, values that are not finite, quaternions not of unit length."""
    sql = f"SELECT pair_id, {', '.join(SIZES)} FROM two_view_geometries"
    for pair, *blobs in database.execute(sql):
        for (name, size), blob in zip(SIZES.items(), blobs, strict=True):
            if not blob:
                continue
            where = f"{name} of pair {divmod(pair, MAX_IMAGES)}"
            if len(blob) != size:
                yield f"{where}: {len(blob)} bytes"
                continue
            values = np.frombuffer(blob, "<f8")
            if not np.isfinite(values).all() or (name == "qvec" and abs(np.linalg.norm(values) - 1) > 1e-9):
                yield f"{where}: {values.tolist()}"
