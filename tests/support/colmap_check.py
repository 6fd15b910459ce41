"""A check of all tables of a COLMAP database against each other, beyond what SQLite itself enforces."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from blur2view.colmap.project import MAX_IMAGES, open_read_only

MATRICES = {"F": 72, "E": 72, "H": 72, "qvec": 32, "tvec": 24}  # bytes
PAIRS = "matches", "two_view_geometries"
FAULTS = [  # each gives a line for everything that is wrong
    "SELECT 'image ' || name || ': no camera' FROM images "
    "WHERE camera_id NOT IN (SELECT camera_id FROM cameras)",
    "SELECT 'keypoints of image ' || image_id FROM keypoints "
    "WHERE cols NOT IN (2, 4, 6) OR length(coalesce(data, '')) != 4 * rows * cols",
]
FRAME_FAULTS = [
    "SELECT 'image ' || name || ': no frame of its camera' FROM images WHERE NOT EXISTS "
    "(SELECT 1 FROM frame_data WHERE data_id = image_id AND sensor_id = camera_id AND sensor_type = 0)",
    "SELECT 'rig ' || rig_id || ' of its frame has no camera ' || sensor_id FROM frame_data "
    "JOIN frames USING (frame_id) WHERE sensor_type = 0 AND (rig_id, sensor_id, 0) NOT IN "
    "(SELECT rig_id, ref_sensor_id, ref_sensor_type FROM rigs "
    "UNION ALL SELECT rig_id, sensor_id, sensor_type FROM rig_sensors)",
]
PAIR_FAULTS = [
    f"SELECT pair_id || ': no such images' FROM {{}} WHERE pair_id / {MAX_IMAGES} >= pair_id % {MAX_IMAGES} "
    f"OR pair_id / {MAX_IMAGES} NOT IN (SELECT image_id FROM keypoints) "
    f"OR pair_id % {MAX_IMAGES} NOT IN (SELECT image_id FROM keypoints)",
    "SELECT pair_id || ': bytes for ' || rows || ' x ' || cols FROM {} "
    "WHERE cols != 2 OR length(coalesce(data, '')) != 8 * rows",
]


def check_database(path: Path) -> list[str]:
    """Return a line for everything that is wrong with a COLMAP database, which is not written.

    SQLite's own integrity and foreign keys; an image without camera, or without frame and rig where frames
    are used; blobs whose size contradicts their row; matches that point beyond the keypoints, occur twice or
    belong to no images; inliers that are no matches; geometries with a matrix that is not finite or a
    quaternion that is not of unit length.
    """
    with open_read_only(path) as database:
        found = [
            f"integrity: {row[0]}" for row in database.execute("PRAGMA integrity_check") if row != ("ok",)
        ]
        found = found or [f"foreign key: {row}" for row in database.execute("PRAGMA foreign_key_check")]
        faults = [*FAULTS, *(sql.format(table) for table in PAIRS for sql in PAIR_FAULTS)]
        tables = {row[0] for row in database.execute("SELECT name FROM sqlite_master")}
        if "frames" in tables and database.execute("SELECT 1 FROM frames").fetchone():
            faults += FRAME_FAULTS
        if not found:
            found = [line for sql in faults for (line,) in database.execute(sql)]
        return found or list(_values(database))


def _values(database: sqlite3.Connection) -> Iterator[str]:
    """Find indices and numbers, in blobs of right sizes, that cannot be."""
    counts, matches = {}, dict[int, set[tuple[int, ...]]]()
    for image, rows, data in database.execute("SELECT image_id, rows, data FROM keypoints"):
        counts[image] = rows
        if not np.isfinite(np.frombuffer(data or b"", "<f4")).all():
            yield f"keypoints of image {image}: not finite"
    for table in PAIRS:
        for pair, data in database.execute(f"SELECT pair_id, data FROM {table}"):
            indices = np.frombuffer(data or b"", "<u4").reshape(-1, 2)
            if (indices >= [counts[image] for image in divmod(pair, MAX_IMAGES)]).any():
                yield f"{table} {pair}: beyond the keypoints"
            listed = set(map(tuple, indices.tolist()))
            if len(listed) != len(indices):
                yield f"{table} {pair}: a match occurs twice"
            if not listed <= matches.setdefault(pair, listed if table == "matches" else set()):
                yield f"{table} {pair}: inliers that are no matches"
    for pair, *blobs in database.execute(f"SELECT pair_id, {', '.join(MATRICES)} FROM two_view_geometries"):
        for (name, size), blob in zip(MATRICES.items(), blobs, strict=True):
            values = (
                np.frombuffer(blob or b"", "<f8") if len(blob or b"") in (0, size) else np.array([np.nan])
            )
            unit = name != "qvec" or not blob or abs(np.linalg.norm(values) - 1) < 1e-9
            if not (np.isfinite(values).all() and unit):
                yield f"{name} of pair {divmod(pair, MAX_IMAGES)}: {len(blob)} bytes, {values.tolist()}"
