"""What a COLMAP database is made of, as SQLite sees it: columns, numbers, blobs, rows of views.

All of it is that of pycolmap 4.2, and tests/colmap/test_schema.py compares it with a file that pycolmap
writes. SQLite writes the rows, to our new databases as to a user's, because ``pycolmap.Database.open``
changes a file before anything is asked of it: it adds tables and columns, turns on write-ahead logging, and
stamps its own version even on a newer file, none of it in a transaction with what comes after.

What the rows rely on
---------------------
- Numbers are little-endian. Keypoints are float32 (N, 2), (N, 4) or (N, 6), x and y first; matches uint32
  (N, 2); F, E, H float64, row-major; qvec is (w, x, y, z) of cam2_from_cam1.
- A pair of images is one row, of key ``2147483647 * id1 + id2`` with id1 < id2; the rows of both match
  tables are oriented from image 1 to image 2. ``rows`` 0 with no data says: matched, without a match.
- If the table of frames has any row, every image needs a frame (the mapper throws otherwise); if it has
  none (databases from before rigs, COLMAP 3.11 and older), the mapper makes a frame of every image itself.
- A camera is sensor type 0 and belongs to exactly one rig.
- The mapper drops a pair with fewer than 15 inliers; the configuration alone excludes only WATERMARK.
"""

from pathlib import Path
from sqlite3 import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.colmap_camera import fundamental_to_colmap, homography_to_colmap, to_colmap
from blur2view.errors import DatabaseError
from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry

NEWEST_KNOWN = 4029999  # user_version of any 4.2
MAX_IMAGES = 2147483647
CAMERA_SENSOR = 0
# Which images blur2view wrote. COLMAP reads and writes its tables by name and ignores others.
VIEWS_TABLE = """
CREATE TABLE IF NOT EXISTS blur2view_views (image_id INTEGER PRIMARY KEY NOT NULL,
  photograph TEXT NOT NULL, role TEXT NOT NULL CHECK(role IN ('open', 'close')), config TEXT NOT NULL,
  time_known INTEGER NOT NULL, time_confidence REAL NOT NULL, source BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
"""


def check_schema(path: Path, database: Connection) -> None:
    """Refuse what is not a COLMAP database of a known version, whole.

    A table or a column that is missing is an error of SQLite's, and ends the transaction that writes to it.
    """
    (version,) = database.execute("PRAGMA user_version").fetchone()
    if version > NEWEST_KNOWN:
        raise DatabaseError(
            f"{path}: written by a newer COLMAP (version {version}, known up to {NEWEST_KNOWN}); "
            "update blur2view"
        )
    if database.execute("SELECT 1 FROM sqlite_master WHERE type = 'trigger'").fetchone():
        raise DatabaseError(f"{path}: has triggers, which COLMAP never makes; remove them first")
    (damage,) = database.execute("PRAGMA quick_check(1)").fetchone()
    if damage != "ok":
        raise DatabaseError(f"{path}: is damaged ({' '.join(damage.split())}); restore a backup")


def pair_id(image1: int, image2: int) -> int:
    """Return the key of a pair of images in both match tables, in either order; ValueError of no such ids."""
    first, last = sorted((image1, image2))
    if not 0 <= first < last < MAX_IMAGES:
        raise ValueError(f"image ids must differ and lie below {MAX_IMAGES}, got {image1} and {image2}")
    return MAX_IMAGES * first + last


def keypoints_from_blob(rows: object, cols: object, data: object) -> NDArray[np.float64]:
    """Return COLMAP's pixels (N, 2) of a row of keypoints; ValueError if the row contradicts itself."""
    return _values(rows, cols, data, "<f4", (2, 4, 6), "keypoints")[:, :2].astype(np.float64)


def matches_from_blob(rows: object, cols: object, data: object) -> NDArray[np.int64]:
    """Return the indices (M, 2) of a row of matches or of inliers; ValueError if it contradicts itself."""
    return _values(rows, cols, data, "<u4", (2,), "matches").astype(np.int64)


def _values(
    rows: object, cols: object, data: object, dtype: str, widths: tuple[int, ...], what: str
) -> NDArray[Any]:
    """Return a blob of numbers of four bytes as an array (rows, cols)."""
    blob = b"" if data is None else data
    if not (isinstance(rows, int) and isinstance(cols, int) and isinstance(blob, bytes)):
        raise ValueError(f"{what} of another type")
    if cols not in widths or rows < 0 or len(blob) != 4 * rows * cols:
        raise ValueError(f"{len(blob)} bytes of {what} for {rows} rows of {cols}")
    return np.frombuffer(blob, dtype).reshape(rows, cols)


def rig_of(database: Connection, camera_id: int) -> int | None:
    """Return the id of the rig that a camera belongs to, None if there is none."""
    sensor = (camera_id, CAMERA_SENSOR)
    for table, prefix in (("rigs", "ref_sensor"), ("rig_sensors", "sensor")):
        sql = f"SELECT rig_id FROM {table} WHERE {prefix}_id = ? AND {prefix}_type = ?"
        row = database.execute(sql, sensor).fetchone()
        if row is not None:
            return int(row[0])
    return None


def add_camera(database: Connection, camera: Any) -> int:
    """Insert a pycolmap.Camera, and a rig of its own; return its id."""
    camera_id = _insert(
        database,
        "cameras",
        model=int(camera.model.value),
        width=camera.width,
        height=camera.height,
        params=_blob(camera.params),
        prior_focal_length=int(camera.has_prior_focal_length),
    )
    _insert(database, "rigs", ref_sensor_id=camera_id, ref_sensor_type=CAMERA_SENSOR)
    return camera_id


def put_image(database: Connection, name: str, camera_id: int, own: int | None, *, with_frame: bool) -> int:
    """Insert an image, or give this camera to our own of this id; return its id.

    With a frame of its own, unless the project has none.
    """
    if own is None:
        image_id = _insert(database, "images", name=name, camera_id=camera_id)
    else:
        image_id = own
        database.execute("UPDATE images SET camera_id = ? WHERE image_id = ?", (camera_id, own))
    if not with_frame:
        return image_id
    if own is not None:
        row = (own, CAMERA_SENSOR)
        there = "FROM frame_data JOIN frames USING (frame_id) WHERE data_id = ? AND sensor_type = ?"
        if database.execute(f"SELECT 1 {there} AND sensor_id = ?", (*row, camera_id)).fetchone():
            return image_id
        of_own = "FROM frame_data WHERE data_id = ? AND sensor_type = ?"
        old = database.execute(f"SELECT frame_id {of_own}", row).fetchall()
        database.execute(f"DELETE {of_own}", row)
        unused = "frame_id = ? AND frame_id NOT IN (SELECT frame_id FROM frame_data)"
        database.executemany(f"DELETE FROM frames WHERE {unused}", old)
    frame_id = _insert(database, "frames", rig_id=rig_of(database, camera_id))
    sensor = {"sensor_id": camera_id, "sensor_type": CAMERA_SENSOR}
    _insert(database, "frame_data", frame_id=frame_id, data_id=image_id, **sensor)
    return image_id


def put_keypoints(database: Connection, image_id: int, points: Array) -> None:
    """Write our pixels (N, 2) as the keypoints of a view, in place of those it had."""
    database.execute("DELETE FROM keypoints WHERE image_id = ?", (image_id,))
    data = _blob(to_colmap(points), "<f4")
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
    both, fit = ({"rows": len(i), "cols": 2, "data": _matches_blob(i)} for i in (matched, inliers))
    _insert(database, "matches", pair_id=key, **both)
    _insert(
        database,
        "two_view_geometries",
        pair_id=key,
        **fit,
        config=list(Configuration).index(geometry.config),
        F=_blob(None if geometry.F is None else fundamental_to_colmap(geometry.F)),
        E=_blob(geometry.E_of_pose),
        H=_blob(None if geometry.H is None else homography_to_colmap(geometry.H)),
        qvec=_blob(None if pose is None else quaternion(pose.rotation)),
        tvec=_blob(None if pose is None else pose.translation),
    )


def _matches_blob(indices: NDArray[np.integer]) -> bytes | None:
    """Return index-aligned matches (i, i) as bytes; None if there are none, as COLMAP has it."""
    return _blob(np.stack([indices, indices], axis=1), "<u4") if len(indices) else None


def _blob(values: NDArray[Any] | None, dtype: str = "<f8") -> bytes | None:
    """Return numbers as bytes, None as None."""
    return None if values is None else np.ascontiguousarray(values, dtype).tobytes()


def quaternion(rotation: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix, w not negative."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(rotation).as_quat(canonical=True), 1)


def _insert(database: Connection, table: str, **row: object) -> int:
    """Insert a row; return its id."""
    sql = f"INSERT INTO {table}({', '.join(row)}) VALUES ({', '.join('?' * len(row))})"
    number = database.execute(sql, tuple(row.values())).lastrowid
    if number is None:
        raise RuntimeError(f"SQLite gave no id to a row of {table}")
    return number
