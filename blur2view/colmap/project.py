"""A user's COLMAP database as SQLite reads it, without changing a byte, and the transaction that adds to it.

``pycolmap.Database.open`` changes a file before anything is asked of it: it adds tables, turns on
write-ahead logging and stamps its version. The format is pycolmap 4.2's: numbers are little-endian;
keypoints float32 (N, 2), (N, 4) or (N, 6), x and y first; matches uint32 (N, 2), from the image of the
smaller id. If the table of frames has any row, every image needs a frame, or the mapper throws; if it has
none (COLMAP 3.11 and older), the mapper makes them. A camera is sensor type 0, of exactly one rig.
"""

import os
import sqlite3
from collections.abc import Container, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from sqlite3 import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.camera import Camera, colmap_camera
from blur2view.errors import CameraError, DatabaseError

NEWEST_KNOWN = 4029999  # user_version of any 4.2
MAX_IMAGES = 2147483647  # COLMAP's kMaxNumImages, by which a pair's id is made
MAX_FRAMES = 2**32 - 1  # COLMAP's kInvalidFrameId
TABLES = {"cameras", "images", "keypoints", "descriptors", "matches", "two_view_geometries", "pose_priors"}
TABLES |= {"rigs", "rig_sensors", "frames", "frame_data", "blur2view_views"}  # that are read
MAX_PARAMETERS = 32  # of a camera (bound): no model has half as many
CAMERA_SENSOR = 0
RIG_OF_CAMERA = f"""
SELECT rig_id FROM rigs WHERE ref_sensor_id = ? AND ref_sensor_type = {CAMERA_SENSOR}
UNION ALL SELECT rig_id FROM rig_sensors WHERE sensor_id = ? AND sensor_type = {CAMERA_SENSOR}"""
# The images that blur2view wrote. COLMAP reads and writes its tables by name and ignores others.
VIEWS_TABLE = """
CREATE TABLE IF NOT EXISTS blur2view_views (image_id INTEGER PRIMARY KEY NOT NULL,
  photograph TEXT NOT NULL, role TEXT NOT NULL CHECK(role IN ('open', 'close')), config TEXT NOT NULL,
  time_known INTEGER NOT NULL, time_confidence REAL NOT NULL, smear_px REAL,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
"""
ADD_SMEAR = "ALTER TABLE blur2view_views ADD COLUMN smear_px REAL"  # to a table of version 0.2.0
LOCK_TIMEOUT_S = 2.0  # to wait while a program locks the database (bound)
LOGS = ("-journal", "-wal")  # endings of SQLite's logs, of changes to be undone or to be done
FOREIGN = ("not a database", "no such table", "no such column")  # in SQLite's errors on foreign files
REMEDY = (
    "close the programs that use it; check its permissions, the free space, and that it is whole; if a "
    "program that used it was killed, open it once with COLMAP"
)


@contextmanager
def open_read_only(path: Path) -> Iterator[Connection]:
    """Open a database for reading; DatabaseError if it is missing, locked, damaged or changes meanwhile."""
    with database_errors(path):
        path = Path(os.path.realpath(path))
        # a read-only connection leaves two files beside a log; without one it needs no lock
        settled = not any(Path(f"{path}{suffix}").exists() for suffix in LOGS)
        before = path.stat()
        with closing(connect(path, "immutable=1" if settled else "mode=ro&readonly_shm=1")) as database:
            database.execute("BEGIN")
            database.execute("SELECT 1 FROM sqlite_master").fetchone()  # takes the lock
            _refuse_views(database)
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
        _refuse_views(database)
        _refuse_triggers(database)
        yield database
        database.execute("COMMIT")


@contextmanager
def database_errors(path: Path) -> Iterator[None]:
    """Raise every error inside as a DatabaseError; a ValueError's message states defect and remedy itself."""
    if not os.path.isfile(path):  # as Path.is_file, but of a name that is too long as well
        raise DatabaseError(f"{path}: no such database; check the path")
    try:
        yield
    except (sqlite3.Error, OSError, OverflowError, ValueError, RuntimeError) as error:
        why = " ".join(str(error).split())  # a damaged schema may hold line breaks
        if isinstance(error, ValueError) and not isinstance(error, UnicodeError):  # that of a damaged schema
            raise DatabaseError(f"{path}: {why}") from None
        if any(words in why for words in FOREIGN):
            remedy = "name the one that COLMAP's --database_path names"
            raise DatabaseError(f"{path}: is not a COLMAP database ({why}); {remedy}") from None
        raise DatabaseError(f"{path}: cannot be used ({why}); {REMEDY}") from None


def connect(path: Path, query: str) -> Connection:
    """Return a connection by SQLite's URI parameters; texts of any bytes are decoded without loss."""
    uri = f"{Path(os.path.realpath(path)).as_uri()}?{query}"
    database = sqlite3.connect(uri, uri=True, timeout=LOCK_TIMEOUT_S, isolation_level=None)
    database.text_factory = lambda data: data.decode("utf-8", "surrogateescape")
    return database


def check_schema(database: Connection) -> None:
    """Raise ValueError if a database is damaged, has triggers, or is of a newer COLMAP than is known."""
    (version,) = database.execute("PRAGMA user_version").fetchone()
    if version > NEWEST_KNOWN:
        versions = f"version {version}; versions up to {NEWEST_KNOWN} are known"
        raise ValueError(f"was written by a newer COLMAP ({versions}); update blur2view")
    (damage,) = database.execute("PRAGMA quick_check(1)").fetchone()
    if damage != "ok":
        raise ValueError(f"is damaged ({damage}); restore a backup")
    _refuse_triggers(database)


def _refuse_views(database: Connection) -> None:
    """Raise ValueError if a table of COLMAP's is a view of SQL, which may never end."""
    for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'view'").fetchall():
        if name.lower() in TABLES:
            raise ValueError(f"its {name} are an SQL view, but COLMAP's are a table; restore a backup")


def _refuse_triggers(database: Connection) -> None:
    """Raise ValueError if a write may start a trigger, which may change rows of the user's."""
    for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'"):
        raise ValueError(f"has the trigger {name}, but COLMAP's databases have none; remove it from a copy")


def image_names(database: Connection) -> dict[str, int]:
    """Return the id of every image by its name, in the order of ids; those not in UTF-8 are left out."""
    rows = database.execute("SELECT name, image_id FROM images ORDER BY image_id").fetchall()
    return {name: number for name, number in rows if isinstance(name, str) and storable(name)}


def longest_suffix(names: Container[str], photograph: Path) -> str | None:
    """Return the longest suffix of a photograph's path that is an image's name, or None."""
    parts = photograph.absolute().parts
    suffixes = ("/".join(parts[start:]) for start in range(1, len(parts)))
    return next((name for name in suffixes if name in names), None)


def storable(name: str) -> bool:
    """Return whether SQLite can hold a name: it is UTF-8."""
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
    """Return the indices (M, 2) of matched keypoints of two images; ValueError of a contradictory row."""
    query = "SELECT rows, cols, data FROM matches WHERE pair_id = ?"
    row = database.execute(query, (pair_id(id1, id2),)).fetchone()
    index = _numbers(row, "<u4", f"matches of images {id1} and {id2}").astype(np.int64)
    return index if id1 < id2 else index[:, ::-1]


def _numbers(row: tuple[Any, Any, Any] | None, dtype: str, what: str) -> NDArray[np.float64]:
    """Return the first two columns (N, 2) of a row's numbers of four bytes; N is 0 without a row."""
    rows, cols, data = row or (0, 2, None)
    blob = b"" if data is None else data
    whole = isinstance(blob, bytes) and isinstance(rows, int) and isinstance(cols, int)
    if not whole or rows < 0 or cols not in (2, 4, 6) or len(blob) != 4 * rows * cols:
        raise ValueError(
            f"{what}: its numbers differ in count or type from what the row states; run COLMAP again"
        )
    with np.errstate(invalid="ignore"):  # of damaged numbers
        return np.frombuffer(blob, dtype).reshape(rows, cols)[:, :2].astype(np.float64)


def read_camera(database: Connection, camera_id: int) -> Camera:
    """Return a camera of the database as known intrinsics; ValueError if pycolmap does not know its model."""
    import pycolmap

    sql = "SELECT model, width, height, params FROM cameras WHERE camera_id = ?"
    model, width, height, params = database.execute(sql, (camera_id,)).fetchone()  # of any type
    if not isinstance(params, bytes):
        raise ValueError(
            f"camera {camera_id} is damaged, because it has no parameters; let COLMAP write it again"
        )
    try:
        kind = pycolmap.CameraModelId.__members__[pycolmap.CameraModelId(model).name].name
        values = tuple(np.frombuffer(params, np.float64)[:MAX_PARAMETERS].tolist())
        camera = colmap_camera(kind, int(width), int(height), values)
        return Camera.from_colmap(camera, f"database, camera {camera_id}")
    except CameraError as error:
        raise ValueError(str(error)) from None
    except (KeyError, TypeError, ValueError, OverflowError):  # OverflowError: of an infinite width
        why = "has a model that this pycolmap does not know; update pycolmap"
        raise ValueError(f"camera {camera_id} {why}") from None


def database_named(text: str) -> tuple[Path, int | None] | None:
    """Return the database and the camera's id of "path.db" or "path.db:ID"; None of any other text.

    A path exists, or ends in .db.
    """
    path, colon, number = text.rpartition(":")
    if colon and number.isdecimal():
        return Path(path), int(number)
    looks_like_one = text.endswith(".db") or os.path.isfile(text)
    return (Path(text), None) if looks_like_one else None


def check_cameras(path: Path) -> None:
    """Raise CameraError if a database cannot be read or has no camera, or if its only one is damaged."""
    try:
        with open_read_only(path) as database:
            count = len(database.execute("SELECT camera_id FROM cameras LIMIT 2").fetchall())
    except DatabaseError as error:
        raise CameraError(str(error)) from None
    if count < 2:
        camera_of_database(path)


def camera_of_database(
    path: str | os.PathLike[str], camera_id: int | None = None, image_name: str = ""
) -> Camera:
    """Return a camera of a COLMAP database: by id, else the image's, else the only one.

    Parameters
    ----------
    path : path
        The database.
    camera_id : int, optional
        COLMAP's number of the camera.
    image_name : str
        The photograph's path; the image whose name it ends with is taken for it.

    Returns
    -------
    Camera
        The intrinsics.

    Raises
    ------
    CameraError
        If the database cannot be read, has no such camera, or leaves the choice open.

    Examples
    --------
    >>> import blur2view
    >>> estimate = blur2view.estimate("models/sample.jpg")
    >>> blur2view.write_database("one.db", [blur2view.views_of("sample.jpg", estimate)])
    >>> camera = blur2view.camera_of_database("one.db", camera_id=1)
    >>> camera.width, camera.height
    (960, 540)
    """
    path = Path(path)
    try:
        with open_read_only(path) as database:
            ids = [number for (number,) in database.execute("SELECT camera_id FROM cameras")]
            names = image_names(database)
            name = longest_suffix(names, Path(image_name)) if image_name else None
            if camera_id is None and name is not None:
                sql = "SELECT camera_id FROM images WHERE image_id = ?"
                (camera_id,) = database.execute(sql, (names[name],)).fetchone()
            if camera_id is None and len(ids) == 1:
                (camera_id,) = ids
            if camera_id is not None and camera_id in ids:
                return read_camera(database, camera_id)
    except DatabaseError as error:
        raise CameraError(str(error)) from None
    if not ids:
        raise CameraError(f"{path}: has no camera; name a database in which COLMAP has extracted features")
    some = ", ".join(map(str, ids[:10]))
    if len(ids) > 10:
        some += " ..."
    wanted = f"no image {Path(image_name).name}" if camera_id is None else f"no camera {camera_id!r:.20}"
    raise CameraError(f"{path}: has {wanted}; it has cameras {some}; name one as {path}:ID")


def has_frames(database: Connection) -> bool:
    """Return whether images of this project have frames; then every image needs one."""
    table = database.execute("SELECT 1 FROM sqlite_master WHERE name = 'frames'").fetchone()
    return bool(table) and database.execute("SELECT 1 FROM frames LIMIT 1").fetchone() is not None


def find_rig(database: Connection, camera_id: int) -> int | None:
    """Return the id of the rig that a camera belongs to, or None."""
    row = database.execute(RIG_OF_CAMERA, (camera_id, camera_id)).fetchone()
    return None if row is None else int(row[0])


def ensure_table(database: Connection) -> None:
    """Make the table of views, or add the column that a table of version 0.2.0 lacks."""
    database.execute(VIEWS_TABLE)
    if "smear_px" not in {row[1] for row in database.execute("PRAGMA table_info(blur2view_views)")}:
        database.execute(ADD_SMEAR)


def smear_lengths(path: Path) -> dict[str, float]:
    """Return the smears' lengths, pixels, of photographs with views in a database, as far as known."""
    sql = "SELECT DISTINCT photograph, smear_px FROM blur2view_views WHERE smear_px IS NOT NULL"
    with suppress(DatabaseError), open_read_only(path) as database:
        return {str(name): float(length) for name, length in database.execute(sql)}
    return {}


def own_views(database: Connection, name: str) -> dict[str, int]:
    """Return the ids, by role, of the views of a photograph that an earlier call wrote."""
    if not database.execute("SELECT 1 FROM sqlite_master WHERE name = 'blur2view_views'").fetchone():
        return {}
    sql = (
        "SELECT role, image_id FROM blur2view_views JOIN images USING (image_id) "
        "WHERE photograph = ? AND name = photograph || '#' || role"
    )
    return dict(database.execute(sql, (name,)).fetchall())
