"""A user's COLMAP database, opened without changing a byte of it or of its folder, or to be linked to.

pycolmap's ``Database.open`` is not used, because it writes (see `blur2view.colmap.project`), and a plain
read-only connection of SQLite is not enough: with a write-ahead log it leaves two files beside the database.
Linking (`blur2view.colmap.link`) writes to the file, in one transaction: its journal outlives a kill at any
moment. A changed copy renamed over the original would lose what others write meanwhile, and its log.
"""

import errno
import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

from blur2view.errors import DatabaseError
from blur2view.input_files import open_regular

LOCK_TIMEOUT_S = 2.0  # to wait while a program locks the database
MAX_VALUE_BYTES = 1 << 26  # of 2.7 million keypoints with scale and orientation
LOGS = ("-journal", "-wal")  # files beside a database with what is to be undone in it, or done
BESIDE = (*LOGS, "-shm")
KILLED = "if a program was killed that used it, open it once with COLMAP"
TABLES = "cameras rigs rig_sensors frames frame_data images keypoints descriptors pose_priors matches"
TABLES += " two_view_geometries blur2view_views"
HINTS = {
    "locked": "another program uses it; close that and try again",
    "changed while": "another program uses it; close that and try again",
    "readonly": f"check permissions; {KILLED}",
    "unable to open": f"check permissions of the file and its folder; {KILLED}",
    "Permission": "check permissions of the file and its folder",
    "disk is full": "make room, or its image ids are used up",
    "image_id_check": "its image ids are used up; extract features into a new database",
}


@contextmanager
def open_read_only(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a COLMAP database for reading; every query inside sees the same state of it, with its log.

    DatabaseError if there is no such file, it is locked, damaged or no database of SQLite, also where a query
    inside shows it; if another program changed it meanwhile, or was killed with a transaction to undo.
    """
    with database_errors(path):
        path = path.resolve()
        # without a log or journal it needs no lock: it changes only when there is one again
        settled = not any(Path(f"{path}{suffix}").exists() for suffix in LOGS)
        before = path.stat()
        with closing(connect(path, "immutable=1" if settled else "mode=ro&readonly_shm=1")) as database:
            database.execute("BEGIN")
            _refuse_views(database)  # takes the lock
            yield database
        after = path.stat()
        if settled and (before.st_mtime_ns, before.st_size) != (after.st_mtime_ns, after.st_size):
            raise sqlite3.OperationalError("changed while it was read")


@contextmanager
def open_for_writing(path: Path) -> Iterator[sqlite3.Connection]:
    """Begin a transaction in the file itself and commit it; a failure inside rolls it back.

    DatabaseError as of `open_read_only`, and of what SQLite refuses to write.
    """
    with database_errors(path), closing(connect(path, "mode=rw")) as database:
        database.execute("PRAGMA foreign_keys = ON")
        database.execute("BEGIN IMMEDIATE")
        _refuse_views(database)
        yield database
        database.execute("COMMIT")


def _refuse_views(database: sqlite3.Connection) -> None:
    """Raise ValueError where a view of SQL stands for a table of COLMAP's: it may compute without end."""
    views = {
        str(name).lower()
        for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'view'")
    }
    if odd := sorted(views & {*TABLES.split()}):
        raise ValueError(f"its {odd[0]} is a view, where COLMAP has a table; remove it")


@contextmanager
def temporary_database() -> Iterator[Path]:
    """Give the path of a database that pycolmap may make; OSError where temporary files cannot be written."""
    try:
        with TemporaryDirectory() as folder:
            yield Path(folder) / "rows.db"
    except RuntimeError as error:
        if "factory" not in str(error):  # what pycolmap says of any database that it cannot open
            raise
        where = f"no database can be written in {gettempdir()}: make room there, or set TMPDIR"
        raise OSError(errno.EIO, where) from None


@contextmanager
def database_errors(path: Path) -> Iterator[None]:
    """Raise every error inside as a DatabaseError, one line with the file and the remedy.

    A ValueError says itself what is wrong with the database and what the remedy is.
    """
    if not path.is_file():
        raise DatabaseError(f"{path}: no such database; check the path")
    try:
        open_regular(path).close()  # SQLite would wait for some files of /proc
        yield
    except (sqlite3.Error, OSError, OverflowError, ValueError, RuntimeError) as error:
        if isinstance(error, ValueError) and not isinstance(error, UnicodeError):  # that of a damaged schema
            raise DatabaseError(f"{path}: {error}") from None
        why = " ".join(str(error).split())  # a damaged schema may hold line breaks
        hint = next((hint for key, hint in HINTS.items() if key in why), "is it whole, and COLMAP's?")
        raise DatabaseError(f"{path}: cannot be used as a COLMAP database ({why}); {hint}") from None


def connect(path: Path, query: str) -> sqlite3.Connection:
    """Return a connection by SQLite's URI parameters; texts of any bytes are decoded without loss.

    A value that is larger than any of COLMAP's that we read is an error of SQLite's, before it is read.
    """
    path = path.resolve()
    for beside in (path.with_name(path.name + suffix) for suffix in BESIDE):
        if os.path.lexists(beside) and not beside.is_file():  # SQLite would wait for a pipe
            raise sqlite3.DatabaseError(f"{beside.name} beside it is no regular file")
    uri = f"{path.as_uri()}?{query}"
    database = sqlite3.connect(uri, uri=True, timeout=LOCK_TIMEOUT_S, isolation_level=None)
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)
    database.text_factory = lambda data: data.decode("utf-8", "surrogateescape")
    return database
