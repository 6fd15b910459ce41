"""What a COLMAP database is made of, as SQLite sees it: columns, numbers, blobs, rows of views.

All of it is that of pycolmap 4.2, which makes new databases, and rows of keypoints, matches and geometries
(`blur2view.colmap.database`). SQLite puts them into a user's database and reads that, because
``pycolmap.Database.open`` changes a file before anything is asked of it: it adds tables and columns, turns on
write-ahead logging, and stamps its own version even on a newer file, in no transaction with what comes after.

What the rows rely on
---------------------
- Numbers are little-endian. Keypoints are float32 (N, 2), (N, 4) or (N, 6), x and y first; matches uint32
  (N, 2).
- A pair of images is one row, of key ``2147483647 * id1 + id2`` with id1 < id2; the rows of both match
  tables are oriented from image 1 to image 2.
- If the table of frames has any row, every image needs a frame (the mapper throws otherwise); if it has
  none (databases from before rigs, COLMAP 3.11 and older), the mapper makes a frame of every image itself.
- A camera is sensor type 0 and belongs to exactly one rig.
- The mapper drops a pair with fewer than 15 inliers; the configuration alone excludes only WATERMARK.
"""

from sqlite3 import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

NEWEST_KNOWN = 4029999  # user_version of any 4.2
MAX_IMAGES = 2147483647
CAMERA_SENSOR = 0
RIG_OF_CAMERA = f"""
SELECT rig_id FROM rigs WHERE ref_sensor_id = ? AND ref_sensor_type = {CAMERA_SENSOR}
UNION ALL SELECT rig_id FROM rig_sensors WHERE sensor_id = ? AND sensor_type = {CAMERA_SENSOR}"""
# Which images blur2view wrote. COLMAP reads and writes its tables by name and ignores others.
VIEWS_TABLE = """
CREATE TABLE IF NOT EXISTS blur2view_views (image_id INTEGER PRIMARY KEY NOT NULL,
  photograph TEXT NOT NULL, role TEXT NOT NULL CHECK(role IN ('open', 'close')), config TEXT NOT NULL,
  time_known INTEGER NOT NULL, time_confidence REAL NOT NULL, source BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
"""


def check_schema(database: Connection) -> None:
    """Raise ValueError of what is not a COLMAP database of a known version, whole.

    A table or a column that is missing is an error of SQLite's, and ends the transaction that writes to it.
    """
    (version,) = database.execute("PRAGMA user_version").fetchone()
    if version > NEWEST_KNOWN:
        known = f"version {version}, known up to {NEWEST_KNOWN}"
        raise ValueError(f"written by a newer COLMAP ({known}); update blur2view")
    if database.execute("SELECT 1 FROM sqlite_master WHERE type = 'trigger'").fetchone():
        raise ValueError("has triggers, which COLMAP never makes; remove them first")
    (damage,) = database.execute("PRAGMA quick_check(1)").fetchone()
    if damage != "ok":
        raise ValueError(f"is damaged ({' '.join(damage.split())}); restore a backup")


def pair_id(image1: int, image2: int) -> int:
    """Return the key of a pair of images in both match tables, in either order; ValueError of no such ids."""
    first, last = sorted((image1, image2))
    if not 0 <= first < last < MAX_IMAGES:
        raise ValueError(f"image ids must differ and lie below {MAX_IMAGES}, got {image1} and {image2}")
    return MAX_IMAGES * first + last


def read_keypoints(database: Connection, image_id: int) -> NDArray[np.float64]:
    """Return COLMAP's pixels (N, 2) of an image's keypoints; ValueError if the row contradicts itself."""
    query = "SELECT rows, cols, data FROM keypoints WHERE image_id = ?"
    return _numbers(database.execute(query, (image_id,)).fetchone(), "<f4", f"keypoints of image {image_id}")


def read_matches(database: Connection, table: str, id1: int, id2: int) -> NDArray[np.int64]:
    """Return the indices (M, 2) of the matched keypoints of two images, in either order of their ids.

    ``table`` is "matches", or "two_view_geometries" for the inliers. ValueError if a row contradicts itself.
    """
    query = f"SELECT rows, cols, data FROM {table} WHERE pair_id = ?"
    row = database.execute(query, (pair_id(id1, id2),)).fetchone()
    index = _numbers(row, "<u4", f"matches of images {id1} and {id2}").astype(np.int64)
    return index if id1 < id2 else index[:, ::-1]  # a row leads from the smaller id


def _numbers(row: tuple[Any, Any, Any] | None, dtype: str, what: str) -> NDArray[np.float64]:
    """Return the first two columns (N, 2) of a row of numbers of four bytes, none without a row."""
    rows, cols, data = row or (0, 2, None)
    blob = b"" if data is None else data
    whole = isinstance(blob, bytes) and isinstance(rows, int) and isinstance(cols, int)
    if not whole or rows < 0 or cols not in (2, 4, 6) or len(blob) != 4 * rows * cols:
        raise ValueError(f"{what}: another count or type of numbers than stated; run COLMAP again")
    return np.frombuffer(blob, dtype).reshape(rows, cols)[:, :2].astype(np.float64)


def rig_of(database: Connection, camera_id: int) -> int | None:
    """Return the id of the rig that a camera belongs to, None if there is none."""
    row = database.execute(RIG_OF_CAMERA, (camera_id, camera_id)).fetchone()
    return None if row is None else int(row[0])


def put_image(
    database: Connection, name: str, camera_id: int, image_id: int | None, *, with_frame: bool
) -> int:
    """Write an image, in place of our own of this id if there is one; return its id.

    With a frame of its own, unless the project has none.
    """
    image_id = put_row(database, "images", image_id=image_id, name=name, camera_id=camera_id)
    if with_frame:
        sensor = {"data_id": image_id, "sensor_type": CAMERA_SENSOR}
        sql = "SELECT frame_id FROM frame_data WHERE data_id = ? AND sensor_type = ?"
        (frame_id,) = database.execute(sql, tuple(sensor.values())).fetchone() or (None,)
        frame_id = put_row(database, "frames", frame_id=frame_id, rig_id=rig_of(database, camera_id))
        put_row(database, "frame_data", frame_id=frame_id, sensor_id=camera_id, **sensor)
    return image_id


def put_row(database: Connection, table: str, **row: object) -> int:
    """Write a row, in place of one of its key; return its id."""
    sql = f"INSERT OR REPLACE INTO {table}({', '.join(row)}) VALUES ({', '.join('?' * len(row))})"
    if (number := database.execute(sql, tuple(row.values())).lastrowid) is None:
        raise RuntimeError(f"SQLite gave no id to a row of {table}")
    return number
