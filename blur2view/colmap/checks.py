"""Whether a database is COLMAP's, and whether every row of the user's is still there.

Tables, columns and the types of values are checked before any work. A schema can do anything with what is
written, replace rows that are there among it: what was lost is counted at the end of the transaction, which
is then undone.
"""

import sqlite3
from collections.abc import Mapping
from pathlib import Path

from blur2view.colmap.schema import COLUMNS, IMAGE_TABLES, MAX_IMAGES, NEWEST_KNOWN, RIG_TABLES
from blur2view.errors import DatabaseError

LONGEST_NAME = 4096  # bytes, of a path
# What COLMAP never writes; its names are texts of a path's length without null characters.
ODD_ROWS = f"""
SELECT 'image', image_id FROM images WHERE typeof(image_id) != 'integer' OR typeof(camera_id) != 'integer'
  OR typeof(name) != 'text' OR length(CAST(name AS BLOB)) > {LONGEST_NAME}
  OR instr(CAST(name AS BLOB), x'00')
UNION ALL
SELECT 'camera', camera_id FROM cameras WHERE typeof(camera_id) != 'integer' OR typeof(model) != 'integer'
  OR typeof(width) != 'integer' OR typeof(height) != 'integer' OR typeof(prior_focal_length) != 'integer'
  OR typeof(params) != 'blob' OR length(params) > {LONGEST_NAME}
LIMIT 1"""
OURS = "(SELECT image_id FROM blur2view_views)"
OF_THE_USER = {  # by table, which rows; of others all
    **dict.fromkeys(("images", "keypoints", "descriptors"), f"image_id NOT IN {OURS}"),
    **dict.fromkeys(
        ("matches", "two_view_geometries"),
        f"pair_id / {MAX_IMAGES} NOT IN {OURS} AND pair_id % {MAX_IMAGES} NOT IN {OURS}",
    ),
    "frame_data": f"data_id NOT IN {OURS}",
    "frames": f"frame_id NOT IN (SELECT frame_id FROM frame_data WHERE data_id IN {OURS})",
    "blur2view_views": "0",
}


def check_schema(path: Path, database: sqlite3.Connection) -> None:
    """Refuse what is not a COLMAP database of a known version, whole, with the tables and columns we use."""
    version = database.execute("PRAGMA user_version").fetchone()[0]
    if version < 0:
        raise DatabaseError(f"{path}: has version {version}, which no COLMAP writes; is it COLMAP's?")
    if version > NEWEST_KNOWN:
        raise DatabaseError(
            f"{path}: written by a newer COLMAP (version {version}, known up to {NEWEST_KNOWN}); "
            "update blur2view"
        )
    schema = dict(database.execute("SELECT name, type FROM sqlite_master").fetchall())
    required = [*IMAGE_TABLES, *(RIG_TABLES if "frames" in schema or "rigs" in schema else ())]
    for table in [*required, *({"blur2view_views"} & schema.keys())]:
        if schema.get(table) != "table":
            raise DatabaseError(f"{path}: has no table {table}; it is no COLMAP database, or not a whole one")
        _check_table(path, database, table)
    if "trigger" in schema.values():
        raise DatabaseError(f"{path}: has triggers, which COLMAP never makes; remove them first")
    damage = [str(row[0]) for row in database.execute("PRAGMA quick_check(1)")]
    if damage != ["ok"]:
        raise DatabaseError(f"{path}: is damaged ({' '.join(damage[0].split())}); restore a backup")
    odd = database.execute(ODD_ROWS).fetchone()
    if odd is not None:
        name = f"{odd[0]} {str(odd[1])[:20]}"
        raise DatabaseError(f"{path}: {name} has values that COLMAP never writes; is it COLMAP's?")


def _check_table(path: Path, database: sqlite3.Connection, table: str) -> None:
    """Refuse a table without our columns, or with others that must be filled."""
    rows = database.execute(f"PRAGMA table_xinfo({table})").fetchall()
    have = {row[1]: (row[3], row[4]) for row in rows}  # NOT NULL, default
    missing = [column for column in COLUMNS[table] if column not in have]
    must = [name for name, (needed, default) in have.items() if needed and default is None]
    foreign = [name for name in must if name not in COLUMNS[table]]
    if missing or foreign:
        what = f"lacks {', '.join(missing)}" if missing else f"has {', '.join(foreign)}, unknown to us"
        raise DatabaseError(f"{path}: table {table} {what}; it is of a COLMAP that we do not know")


def check_room(path: Path, database: sqlite3.Connection, count: int) -> None:
    """Refuse where so many new images would get ids that are used up."""
    (first,) = database.execute("SELECT ifnull(max(image_id), 0) + 1 FROM images").fetchone()
    if database.execute("SELECT 1 FROM sqlite_master WHERE name = 'sqlite_sequence'").fetchone():
        sql = "SELECT ifnull(max(seq), 0) + 1 FROM sqlite_sequence WHERE name = 'images'"
        first = max(first, *database.execute(sql).fetchone())
    if first + count > MAX_IMAGES:
        raise DatabaseError(f"{path}: its image ids are used up; extract features into a new database")


def rows_of_the_user(database: sqlite3.Connection) -> Mapping[str, int]:
    """Return of every table how many rows blur2view did not write; the table of its views must be there."""
    return {
        table: int(database.execute(f'SELECT count(*) FROM "{table}" WHERE {which}').fetchone()[0])
        for table in sorted(_plain_tables(database))
        for which in [OF_THE_USER.get(table, "1")]
    }


def _plain_tables(database: sqlite3.Connection) -> set[str]:
    """Return the names of the tables that hold rows, SQLite's own left out."""
    sql = (
        "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite\\_%' ESCAPE '\\' "
        "AND sql NOT LIKE 'CREATE VIRTUAL%'"
    )
    return {name.replace('"', '""') for (name,) in database.execute(sql)}
