"""Whether a database is COLMAP's, and whether every row of the user's is still there.

Tables and columns are checked before any work. A schema can do anything with what is
written, replace rows that are there among it: what was lost is counted at the end of the transaction, which
is then undone.
"""

import sqlite3
from pathlib import Path

from blur2view.colmap.schema import IMAGE_TABLES, MAX_IMAGES, NEWEST_KNOWN, RIG_TABLES, insertion
from blur2view.errors import DatabaseError

OURS = "(SELECT image_id FROM blur2view_views)"
OF_THE_USER = {  # by table, which rows; of the others none is changed
    **dict.fromkeys(("images", "keypoints", "descriptors"), f"image_id NOT IN {OURS}"),
    **dict.fromkeys(
        ("matches", "two_view_geometries"),
        f"pair_id / {MAX_IMAGES} NOT IN {OURS} AND pair_id % {MAX_IMAGES} NOT IN {OURS}",
    ),
    "frame_data": f"data_id NOT IN {OURS}",
    "frames": f"frame_id NOT IN (SELECT frame_id FROM frame_data WHERE data_id IN {OURS})",
}


def check_schema(path: Path, database: sqlite3.Connection) -> None:
    """Refuse what is not a COLMAP database of a known version, whole, with the tables and columns we use.

    A table or a column that is missing is an error of SQLite's.
    """
    (version,) = database.execute("PRAGMA user_version").fetchone()
    if version > NEWEST_KNOWN:
        raise DatabaseError(
            f"{path}: written by a newer COLMAP (version {version}, known up to {NEWEST_KNOWN}); "
            "update blur2view"
        )
    schema = dict(database.execute("SELECT name, type FROM sqlite_master").fetchall())
    if "trigger" in schema.values():
        raise DatabaseError(f"{path}: has triggers, which COLMAP never makes; remove them first")
    rig_tables = RIG_TABLES if {"frames", "rigs"} & schema.keys() else {}
    for table, columns in (IMAGE_TABLES | rig_tables).items():
        database.execute(f"EXPLAIN {insertion(table, columns)}", [None] * len(columns))
    (damage,) = database.execute("PRAGMA quick_check(1)").fetchone()
    if damage != "ok":
        raise DatabaseError(f"{path}: is damaged ({' '.join(damage.split())}); restore a backup")


def rows_of_the_user(database: sqlite3.Connection) -> dict[str, int]:
    """Return of every table of COLMAP's how many rows blur2view did not write; ours must be there."""
    tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    return {
        table: int(database.execute(f"SELECT count(*) FROM {table} WHERE {which}").fetchone()[0])
        for table, which in OF_THE_USER.items()
        if table in tables
    }
