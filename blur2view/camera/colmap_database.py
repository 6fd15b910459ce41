"""A user's COLMAP database, opened without changing a byte of it or of its folder, and the cameras in it.

All that reads a user's database opens it here; only linking (`blur2view.colmap.link`) writes. pycolmap's
``Database.open`` is not used, because it writes (see `blur2view.colmap.schema`), and a plain read-only
connection of SQLite is not enough: with a write-ahead log it creates two files beside the database and leaves
them there, and after a killed program it refuses to read.
"""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Container, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np

from blur2view.camera.colmap_camera import colmap_camera
from blur2view.errors import CameraError, DatabaseError

LOCK_TIMEOUT_S = 2.0  # how long to wait for the lock of another program
WAL_FORMAT = 2  # the read version in SQLite's header, byte 19, of a database with a write-ahead log
NEEDS_WRITING = (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN)  # primary codes: what a recovery needs
HINTS = {
    "locked": "another program uses it; close that and try again",
    "changed while": "another program uses it; close that and try again",
    "readonly": "it cannot be written; check permissions",
    "unable to open": "check permissions of the file and its folder",
    "Permission": "check permissions of the file and its folder",
    "disk is full": "make room",
    "image_id_check": "its image ids are used up; extract features into a new database",
}

CameraRow = tuple[int, int, int, int, bytes]  # id, COLMAP's model number, width, height, float64 params


@contextmanager
def open_read_only(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a COLMAP database for reading; every query inside sees the same state of it.

    What another program has written but not yet moved from the write-ahead log into the file is read too, and
    what a killed one has written in part is left out.

    Raises
    ------
    DatabaseError
        If there is no such file, it is locked, damaged or no database of SQLite, also where a query inside
        shows it; if another program changed it meanwhile.
    """
    with database_errors(path), ExitStack() as stack:
        path = path.resolve()
        try:
            database = stack.enter_context(_begun(path, "mode=ro&readonly_shm=1"))
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF not in NEEDS_WRITING:
                raise
            # a killed program left a journal to undo or a log to index: SQLite does it in a copy
            copy = _copied(path, Path(stack.enter_context(TemporaryDirectory())))
            database = stack.enter_context(_begun(copy, "mode=rw"))
        yield database


@contextmanager
def database_errors(path: Path) -> Iterator[None]:
    """Raise every error of SQLite inside as a DatabaseError, one line with the file and the remedy."""
    if not path.is_file():
        raise DatabaseError(f"{path}: no such database; check the path")
    try:
        yield
    except (sqlite3.Error, OSError, OverflowError, UnicodeError) as error:  # UnicodeError: of a schema
        why = " ".join(str(error).split())  # a damaged schema may hold line breaks
        hint = next((hint for key, hint in HINTS.items() if key in why), "is it whole, and COLMAP's?")
        raise DatabaseError(f"{path}: cannot be used as a COLMAP database ({why}); {hint}") from None


@contextmanager
def _begun(path: Path, query: str) -> Iterator[sqlite3.Connection]:
    """Yield a connection whose read transaction has begun."""
    # A closed log needs no lock: its database changes only when a log is there again and written back.
    closed_log = _has_log_format(path) and not path.with_name(f"{path.name}-wal").exists()
    before = path.stat()
    with closing(connect(path, "immutable=1" if closed_log else query)) as database:
        database.execute("BEGIN")
        database.execute("SELECT 1 FROM sqlite_master").fetchone()  # takes the lock
        yield database
    after = path.stat()
    if closed_log and (before.st_mtime_ns, before.st_size) != (after.st_mtime_ns, after.st_size):
        raise sqlite3.OperationalError("changed while it was read")


def connect(path: Path, query: str) -> sqlite3.Connection:
    """Return a connection by SQLite's URI parameters; texts of any bytes are decoded without loss."""
    uri = f"{path.resolve().as_uri()}?{query}"
    database = sqlite3.connect(uri, uri=True, timeout=LOCK_TIMEOUT_S, isolation_level=None)
    database.text_factory = lambda data: data.decode("utf-8", "surrogateescape")
    return database


def _has_log_format(path: Path) -> bool:
    """Return whether the header says that the database is used with a write-ahead log."""
    if not path.stat().st_size:
        return False
    with path.open("rb") as file:
        return file.read(20)[19:] == bytes([WAL_FORMAT])


def _copied(path: Path, folder: Path) -> Path:
    """Copy a database with its journal or log; return the copy."""
    for suffix in ("", "-journal", "-wal"):
        source = path.with_name(path.name + suffix)
        if source.is_file():
            shutil.copyfile(source, folder / f"copy.db{suffix}")
    return folder / "copy.db"


def longest_suffix(names: Container[str], photograph: Path) -> str | None:
    """Return the longest suffix of a photograph's path that is an image's name, None if there is none.

    So "/data/left/a.jpg" is "left/a.jpg" of a database that has it, else "a.jpg".
    """
    parts = photograph.absolute().parts
    suffixes = ("/".join(parts[start:]) for start in range(1, len(parts)))
    return next((name for name in suffixes if name in names), None)


def database_cameras(path: Path) -> tuple[list[CameraRow], dict[str, int]]:
    """Return the cameras of a COLMAP database, of any version, and the camera id of every image by its name.

    CameraError if there is no such file, it is locked or damaged, or is no COLMAP database.
    """
    try:
        with open_read_only(path) as database:
            rows = database.execute("SELECT camera_id, model, width, height, params FROM cameras").fetchall()
            images = database.execute("SELECT name, camera_id FROM images").fetchall()
    except DatabaseError as error:
        raise CameraError(str(error)) from None
    return cast(list[CameraRow], rows), dict(images)


def choose_camera(path: Path, camera_id: int | None, image_name: str) -> tuple[int, Any]:
    """Return id and pycolmap.Camera of a database: the one asked for, the image's, or the only one.

    ``image_name`` is the photograph's path; the database's image whose name it ends with is taken for it.
    CameraError if the database cannot be read, has no such camera, or leaves the choice open.
    """
    rows, of_image = database_cameras(path)
    by_id = {row[0]: row for row in rows}
    if camera_id is None:
        camera_id = _camera_of(path, list(by_id), of_image, image_name)
    if camera_id not in by_id:
        have = ", ".join(map(str, by_id)) or "none"
        raise CameraError(f"{path}: has no camera {camera_id}; it has {have}")
    _, model, width, height, params = by_id[camera_id]
    try:
        import pycolmap

        name = pycolmap.CameraModelId.__members__[pycolmap.CameraModelId(model).name].name
        values = tuple(np.frombuffer(params, np.float64).tolist())
        width, height = int(width), int(height)
    except (KeyError, TypeError, ValueError):
        raise CameraError(
            f"{path}: camera {camera_id} is of a kind this pycolmap does not know; update pycolmap"
        ) from None
    return camera_id, colmap_camera(name, width, height, values)


def _camera_of(path: Path, ids: list[int], of_image: dict[str, int], image_name: str) -> int:
    """Return the camera of the image whose name is the longest suffix of the path, else the only one."""
    name = longest_suffix(of_image, Path(image_name)) if image_name else None
    if name is not None:
        return of_image[name]
    if len(ids) == 1:
        return ids[0]
    have = ", ".join(map(str, ids)) or "none"
    raise CameraError(
        f"{path}: knows no image {Path(image_name).name} and has several cameras or none ({have}); "
        f"name one as {path}:ID"
    )
