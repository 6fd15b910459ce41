"""A user's COLMAP project as SQLite sees it: read without changing a byte of it, or to be linked to.

``pycolmap.Database.open`` changes a file before anything is asked of it: it adds tables, turns on
write-ahead logging and stamps its version. The format is pycolmap 4.2's: numbers are little-endian;
keypoints float32 (N, 2), (N, 4) or (N, 6), x and y first; matches uint32 (N, 2), from the image of the
smaller id. If the table of frames has any row, every image needs a frame, or the mapper throws; if it has
none (COLMAP 3.11 and older), the mapper makes them. A camera is sensor type 0, of exactly one rig.
"""

import sqlite3
from collections.abc import Container, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from sqlite3 import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.errors import DatabaseError

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
  time_known INTEGER NOT NULL, time_confidence REAL NOT NULL, smear_px REAL,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
"""
PUT_VIEW = (
    "INSERT OR REPLACE INTO blur2view_views(image_id, photograph, role, config, time_known, time_confidence, "
    "smear_px) VALUES (?, ?, ?, ?, ?, ?, ?)"
)
ADD_SMEAR = "ALTER TABLE blur2view_views ADD COLUMN smear_px REAL"  # to a table of 0.2.0
LOCK_TIMEOUT_S = 2.0  # to wait while a program locks the database
LOGS = ("-journal", "-wal")  # files beside a database with what is to be undone in it, or done
REMEDY = (
    "close programs that use it; check that it is whole, permissions, room and its image ids; if a program "
    "was killed that used it, open it once with COLMAP"
)


@contextmanager
def open_read_only(path: Path) -> Iterator[Connection]:
    """Open a database for reading; DatabaseError if it is missing, locked, damaged or changes meanwhile."""
    with database_errors(path):
        path = path.resolve()
        # a read-only connection leaves two files beside a log; without one it needs no lock
        settled = not any(Path(f"{path}{suffix}").exists() for suffix in LOGS)
        before = path.stat()
        with closing(connect(path, "immutable=1" if settled else "mode=ro&readonly_shm=1")) as database:
            database.execute("BEGIN")
            database.execute("SELECT 1 FROM sqlite_master").fetchone()  # takes the lock
            yield database
        after = path.stat()
        if settled and (before.st_mtime_ns, before.st_size) != (after.st_mtime_ns, after.st_size):
            raise sqlite3.OperationalError("changed while it was read")


@contextmanager
def open_for_writing(path: Path) -> Iterator[Connection]:
    """Begin a transaction in the file and commit it; a failure inside rolls it back (DatabaseError)."""
    with database_errors(path), closing(connect(path, "mode=rw")) as database:
        database.execute("PRAGMA foreign_keys = ON")
        database.execute("BEGIN IMMEDIATE")
        yield database
        database.execute("COMMIT")


@contextmanager
def database_errors(path: Path) -> Iterator[None]:
    """Raise every error inside as a DatabaseError; a ValueError says itself what is wrong and the remedy."""
    if not path.is_file():
        raise DatabaseError(f"{path}: no such database; check the path")
    try:
        yield
    except (sqlite3.Error, OSError, OverflowError, ValueError, RuntimeError) as error:
        why = " ".join(str(error).split())  # a damaged schema may hold line breaks
        if isinstance(error, ValueError) and not isinstance(error, UnicodeError):  # that of a damaged schema
            raise DatabaseError(f"{path}: {why}") from None
        raise DatabaseError(f"{path}: cannot be used as a COLMAP database ({why}); {REMEDY}") from None


def connect(path: Path, query: str) -> Connection:
    """Return a connection by SQLite's URI parameters; texts of any bytes are decoded without loss."""
    uri = f"{path.resolve().as_uri()}?{query}"
    database = sqlite3.connect(uri, uri=True, timeout=LOCK_TIMEOUT_S, isolation_level=None)
    database.text_factory = lambda data: data.decode("utf-8", "surrogateescape")
    return database


def check_schema(database: Connection) -> None:
    """Raise ValueError of a damaged database, or one of a newer COLMAP than is known."""
    (version,) = database.execute("PRAGMA user_version").fetchone()
    if version > NEWEST_KNOWN:
        known = f"version {version}, known up to {NEWEST_KNOWN}"
        raise ValueError(f"written by a newer COLMAP ({known}); update blur2view")
    (damage,) = database.execute("PRAGMA quick_check(1)").fetchone()
    if damage != "ok":
        raise ValueError(f"is damaged ({damage}); restore a backup")


def image_names(database: Connection) -> dict[str, int]:
    """Return the id of every image by its name, in the order of ids; names that are no UTF-8 are left out."""
    rows = database.execute("SELECT name, image_id FROM images ORDER BY image_id").fetchall()
    return {name: number for name, number in rows if isinstance(name, str) and storable(name)}


def longest_suffix(names: Container[str], photograph: Path) -> str | None:
    """Return the longest suffix of a photograph's path that is an image's name, or None."""
    parts = photograph.absolute().parts
    suffixes = ("/".join(parts[start:]) for start in range(1, len(parts)))
    return next((name for name in suffixes if name in names), None)


def storable(name: str) -> bool:
    """Return whether SQLite can hold a name; it cannot hold bytes that are no UTF-8."""
    return not any("\ud800" <= character <= "\udfff" for character in name)


def pair_id(image1: int, image2: int) -> int:
    """Return the key of a pair of images in both match tables, in either order."""
    first, last = sorted((image1, image2))
    return MAX_IMAGES * first + last


def read_keypoints(database: Connection, image_id: int) -> NDArray[np.float64]:
    """Return COLMAP's pixels (N, 2) of an image's keypoints; ValueError if the row contradicts itself."""
    query = "SELECT rows, cols, data FROM keypoints WHERE image_id = ?"
    return _numbers(database.execute(query, (image_id,)).fetchone(), "<f4", f"keypoints of image {image_id}")


def read_matches(database: Connection, id1: int, id2: int) -> NDArray[np.int64]:
    """Return the indices (M, 2) of matched keypoints of two images; ValueError as of `read_keypoints`."""
    query = "SELECT rows, cols, data FROM matches WHERE pair_id = ?"
    row = database.execute(query, (pair_id(id1, id2),)).fetchone()
    index = _numbers(row, "<u4", f"matches of images {id1} and {id2}").astype(np.int64)
    return index if id1 < id2 else index[:, ::-1]


def _numbers(row: tuple[Any, Any, Any] | None, dtype: str, what: str) -> NDArray[np.float64]:
    """Return the first two columns (N, 2) of a row of numbers of four bytes, none without a row."""
    rows, cols, data = row or (0, 2, None)
    blob = b"" if data is None else data
    whole = isinstance(blob, bytes) and isinstance(rows, int) and isinstance(cols, int)
    if not whole or rows < 0 or cols not in (2, 4, 6) or len(blob) != 4 * rows * cols:
        raise ValueError(f"{what}: another count or type of numbers than stated; run COLMAP again")
    return np.frombuffer(blob, dtype).reshape(rows, cols)[:, :2].astype(np.float64)


def has_frames(database: Connection) -> bool:
    """Return whether images of this project have frames; then every image needs one."""
    table = database.execute("SELECT 1 FROM sqlite_master WHERE name = 'frames'").fetchone()
    return bool(table) and database.execute("SELECT 1 FROM frames LIMIT 1").fetchone() is not None


def rig_of(database: Connection, camera_id: int) -> int | None:
    """Return the id of the rig that a camera belongs to, or None."""
    row = database.execute(RIG_OF_CAMERA, (camera_id, camera_id)).fetchone()
    return None if row is None else int(row[0])


def ensure_table(database: Connection) -> None:
    """Make the table of views, or give one of an earlier version the column that it lacks."""
    database.execute(VIEWS_TABLE)
    if "smear_px" not in {row[1] for row in database.execute("PRAGMA table_info(blur2view_views)")}:
        database.execute(ADD_SMEAR)


def smear_lengths(path: Path) -> dict[str, float]:
    """Return the length of the smear of each photograph with views in a database, pixels, if known."""
    sql = "SELECT DISTINCT photograph, smear_px FROM blur2view_views WHERE smear_px IS NOT NULL"
    try:
        with open_read_only(path) as database:
            return {str(name): float(length) for name, length in database.execute(sql)}
    except DatabaseError:
        return {}


def own_views(database: Connection, name: str) -> dict[str, int]:
    """Return the ids of the existing views of a photograph that blur2view wrote, by role."""
    if not database.execute("SELECT 1 FROM sqlite_master WHERE name = 'blur2view_views'").fetchone():
        return {}
    sql = (
        "SELECT role, image_id FROM blur2view_views JOIN images USING (image_id) "
        "WHERE photograph = ? AND name = photograph || '#' || role"
    )
    return dict(database.execute(sql, (name,)).fetchall())
