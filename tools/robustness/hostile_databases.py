"""COLMAP projects whose values, schema or files are not what they should be, drawn from a generator."""

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import numpy as np

from tools.database_safety.colmap_projects import ProjectOptions, make_project, user_rows
from tools.database_safety.malformed_projects import BYTE_FAULTS, SQL_FAULTS
from tools.robustness.damage import Rng
from tools.robustness.politeness import STREAMS, Call

DATABASE, SIZE = "project.db", (120, 90)
LINKS = (
    ("to-colmap", "--link", "--db", DATABASE),
    ("to-colmap", "--link", "--replace", "--no-backup", "--json", "--db", DATABASE),
    ("estimate", "--json", "--camera", f"{DATABASE}:1"),
    ("estimate", "--json", "--camera", DATABASE),
)
VALUES = (
    "NULL", "-1", "0", "3", "9e999", "-9e999", "0.5", "1 << 62", "2147483646", "'text'", "''", "x''", "x'00'",
    "'7'", "CAST(x'FF00FE' AS TEXT)", "'a' || char(27) || '[2J'", "'a' || char(0)",
    "CAST(zeroblob(5000) AS TEXT)", "zeroblob(90000000)", "zeroblob(96)", "'good.jpg#open'",
    "CAST('good.jpg#close' AS BLOB)", "'good.jpg'",
    "CAST('good.jpg' AS BLOB)", "zeroblob(960)",
)  # fmt: skip
CLAUSES = (
    "UNIQUE ({0}) ON CONFLICT REPLACE", "UNIQUE ({0}) ON CONFLICT IGNORE", "CHECK ({0} != 4)", "UNIQUE ({0})",
    "FOREIGN KEY ({0}) REFERENCES cameras(camera_id) ON DELETE CASCADE",
)  # fmt: skip
TABLES = ("images", "keypoints", "matches", "two_view_geometries", "frames", "frame_data", "rigs", "cameras")
SCHEMAS = (
    "CREATE TRIGGER t AFTER {1} ON {0} BEGIN DELETE FROM keypoints WHERE image_id = 1; END",
    "CREATE UNIQUE INDEX u ON {0}({2})",
    "CREATE INDEX i ON {0}({2} + 1)",
    "ALTER TABLE {0} ADD COLUMN more AS ({2} || 'x')",
    "ALTER TABLE {0} ADD COLUMN more TEXT NOT NULL DEFAULT 'x'",
    "CREATE TABLE more (one REFERENCES {0}({2}) ON DELETE CASCADE ON UPDATE CASCADE)",
    "CREATE VIEW v AS SELECT * FROM {0}",
    "ALTER TABLE {0} RENAME COLUMN {2} TO other",
    "CREATE VIRTUAL TABLE found USING fts5(name)",
)


def put_database(folder: Path, words: tuple[str, ...], *, seed: tuple[int, ...]) -> None:
    """Make a hostile project of two photographs in the folder of a call."""
    rng, path = np.random.default_rng(seed), folder / DATABASE
    make_project(
        path, ProjectOptions(old=rng.random() < 0.2, wal=rng.random() < 0.3, size=SIZE), seed=seed[-1]
    )
    with closing(sqlite3.connect(path)) as database:
        database.execute("UPDATE images SET name = 'good.jpg' WHERE image_id = 2")
        database.commit()
    kind = int(rng.integers(6))
    if kind == 0:
        faults = list(SQL_FAULTS.values())
        _run(path, faults[int(rng.integers(len(faults)))].replace("a_001.jpg", "good.jpg"))
    elif kind < 3:
        for _ in range(int(rng.integers(1, 4))):
            _run(path, _odd_value(path, rng))
    elif kind == 3:
        _run(path, _odd_schema(path, rng))
    elif kind == 4:
        fault = list(BYTE_FAULTS.values())[int(rng.integers(len(BYTE_FAULTS)))]
        path.write_bytes(fault(path.read_bytes(), rng))
    else:
        _odd_neighbour(path, rng)


def _run(path: Path, sql: str) -> None:
    with closing(sqlite3.connect(path)) as database, suppress(sqlite3.Error):
        database.execute("PRAGMA ignore_check_constraints = ON")
        database.executescript(sql)
        database.commit()


def _columns(path: Path, rng: Rng) -> tuple[str, list[str]]:
    table = TABLES[int(rng.integers(len(TABLES)))]
    with closing(sqlite3.connect(path)) as database:
        return table, [row[1] for row in database.execute(f"PRAGMA table_info({table})")] or ["rowid"]


def _odd_value(path: Path, rng: Rng) -> str:
    table, columns = _columns(path, rng)
    value = VALUES[int(rng.integers(len(VALUES)))]
    row = "" if rng.random() < 0.3 else f" WHERE rowid = {int(rng.integers(1, 4))}"
    return f"UPDATE OR IGNORE {table} SET {columns[int(rng.integers(len(columns)))]} = {value}{row}"


def _odd_schema(path: Path, rng: Rng) -> str:
    """Return statements that change how a table is made."""
    table, columns = _columns(path, rng)
    column = columns[int(rng.integers(len(columns)))]
    if rng.random() < 0.4:
        event = str(rng.choice(["INSERT", "UPDATE", "DELETE"]))
        return SCHEMAS[int(rng.integers(len(SCHEMAS)))].format(table, event, column)
    clause = CLAUSES[int(rng.integers(len(CLAUSES)))].format(column)
    if rng.random() < 0.3:
        clause = str(rng.choice(["WITHOUT ROWID", "STRICT"]))
        change = f"substr(sql, 1, length(sql) - 1) || ') {clause}'"
    else:
        change = f"substr(sql, 1, length(sql) - 1) || ', {clause})'"
    return f"""
        CREATE TABLE old AS SELECT * FROM {table};
        PRAGMA writable_schema = 1;
        UPDATE sqlite_master SET sql = {change} WHERE name = '{table}';
        PRAGMA writable_schema = RESET;
        REINDEX;"""


def _odd_neighbour(path: Path, rng: Rng) -> None:
    """Put something beside the database that SQLite would use, or let it be used with a log."""
    beside = path.with_name(path.name + str(rng.choice(["-journal", "-wal", "-shm"])))
    beside.unlink(missing_ok=True)
    match int(rng.integers(4)):
        case 0:
            os.mkfifo(beside)
        case 1:
            beside.mkdir()
        case 2:
            beside.symlink_to(str(rng.choice(["/dev/zero", "/dev/random", "nowhere"])))
        case _:
            beside.write_bytes(rng.bytes(int(rng.integers(1, 9000))))


Before = tuple[dict[str, bytes], object]


def snapshot(folder: Path) -> Before:
    """Return the files of a folder, and all rows of the user's, None where SQLite cannot read them."""
    files = {
        path.name: path.read_bytes() if path.is_file() else b""
        for path in folder.iterdir()
        if path.name not in STREAMS and path.resolve().parent == folder.resolve()
    }
    return files, _rows(folder / DATABASE)


def _rows(path: Path) -> object:
    """Return all rows of the user's in a copy of a database, with its log."""
    copy = path.parent.parent / f"{path.parent.name}-copy.db"
    beside = [path.with_name(path.name + end) for end in ("", "-wal", "-journal")]
    try:
        for one in beside:
            if one.is_file() and one.resolve().is_relative_to(path.parent.resolve()):
                shutil.copy(one, f"{copy}{one.name.removeprefix(path.name)}")
        return user_rows(copy)
    except (sqlite3.Error, UnicodeDecodeError, OverflowError, OSError):
        return None
    finally:
        for end in ("", "-wal", "-journal", "-shm"):
            Path(f"{copy}{end}").unlink(missing_ok=True)


def changes(call: Call, before: Before) -> Iterator[str]:
    """Complain about what a call has changed: any byte where it refused, a row of the user's where not."""
    files, rows = before
    now, rows_now = snapshot(call.folder)
    linked = "--link" in call.words and call.code == 0
    if not linked and now != files:
        odd = sorted(name for name in now.keys() | files.keys() if now.get(name) != files.get(name))
        yield f"exit code {call.code}, but {', '.join(odd)} changed"
    if linked and rows != rows_now:
        yield "rows of the user's changed"
