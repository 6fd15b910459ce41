"""Small COLMAP projects as a user may have them, to test what we write into them."""

import sqlite3
import struct
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from blur2view import Configuration, ExposureViews, TimeDirection, TwoViewGeometry
from blur2view.colmap.project import MAX_IMAGES, open_read_only

SIZE = (96, 64)
OLD_TABLES = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL,
  width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,
  camera_id INTEGER NOT NULL, prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL, prior_tx REAL,
  prior_ty REAL, prior_tz REAL, CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
  FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
  data BLOB, FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
  data BLOB, FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
  data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
  cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB);
"""

Rows = dict[str, list[tuple[Any, ...]]]


@dataclass(frozen=True, kw_only=True)
class ProjectOptions:
    """``images`` photographs "a_000.jpg", ... with ``features`` keypoints each, matched with the next.

    ``old`` makes a database of COLMAP 3.9, before rigs; ``frames`` False one that has the tables of rigs and
    frames but no rows; ``wal`` turns on write-ahead logging, as pycolmap does.
    """

    images: int = 3
    features: int = 40
    size: tuple[int, int] = SIZE
    old: bool = False
    frames: bool = True
    wal: bool = True


def make_project(path: Path, options: ProjectOptions | None = None, seed: int = 0) -> list[str]:
    """Write a project and return the names of its images."""
    o, rng = options or ProjectOptions(), np.random.default_rng(seed)
    names = [f"a_{index:03d}.jpg" for index in range(o.images)]
    if not o.old:
        pycolmap.Database.open(path).close()
    with closing(sqlite3.connect(path)) as database:
        database.execute(f"PRAGMA journal_mode = {'WAL' if o.wal else 'DELETE'}")
        if o.old:
            database.executescript(f"{OLD_TABLES} PRAGMA user_version = 3900;")
        params = struct.pack("<4d", 1.1 * o.size[0], o.size[0] / 2, o.size[1] / 2, 0.01)
        database.execute("INSERT INTO cameras VALUES (1, 2, ?, ?, ?, 1)", (*o.size, params))
        for index, name in enumerate(names, 1):
            _add_image(database, rng, index, name, o)
        if o.frames and not o.old:
            database.execute("INSERT INTO rigs VALUES (1, 1, 0)")
            for index in range(1, o.images + 1):
                database.execute("INSERT INTO frames VALUES (?, 1)", (index,))
                database.execute("INSERT INTO frame_data VALUES (?, ?, 1, 0)", (index, index))
        database.commit()
    return names


def _add_image(
    database: sqlite3.Connection, rng: np.random.Generator, index: int, name: str, o: ProjectOptions
) -> None:
    """Insert an image with keypoints of six columns, as SIFT's, and matches with the one before."""
    database.execute("INSERT INTO images(image_id, name, camera_id) VALUES (?, ?, 1)", (index, name))
    keypoints = rng.uniform(0, 1, (o.features, 6)).astype("<f4")
    keypoints[:, :2] *= np.array(o.size, "<f4")
    columns = "(image_id, rows, cols, data) VALUES (?, ?, ?, ?)"
    database.execute(f"INSERT INTO keypoints{columns}", (index, o.features, 6, keypoints.tobytes()))
    if o.old:
        descriptors = rng.integers(0, 256, (o.features, 128), np.uint8).tobytes()
        database.execute(f"INSERT INTO descriptors{columns}", (index, o.features, 128, descriptors))
    if index > 1:
        key, count = MAX_IMAGES * (index - 1) + index, o.features // 2
        matches = np.stack([rng.permutation(o.features)[:count] for _ in range(2)], axis=1)
        data = matches.astype("<u4").tobytes()
        database.execute("INSERT INTO matches VALUES (?, ?, 2, ?)", (key, count, data))
        sql = (
            "INSERT INTO two_view_geometries(pair_id, rows, cols, data, config, F) VALUES (?, ?, 2, ?, 3, ?)"
        )
        database.execute(sql, (key, count, data, rng.normal(size=9).tobytes()))


def user_rows(path: Path) -> Rows:
    """Return the rows of all tables that blur2view did not write, but for SQLite's own counters of ids."""
    with closing(sqlite3.connect(path)) as database:
        database.text_factory = bytes
        sql = "SELECT CAST(name AS BLOB) FROM sqlite_master WHERE type = 'table'"
        rows = {name.decode(): _table_rows(database, name.decode()) for (name,) in database.execute(sql)}
    ours = {int(row[0]) for row in rows.pop("blur2view_views", [])}
    rows.pop("sqlite_sequence", None)
    frames = {row[0] for row in rows.get("frame_data", []) if row[1] in ours}

    def is_ours(table: str, row: tuple[Any, ...]) -> bool:
        if table in ("matches", "two_view_geometries"):
            return isinstance(row[0], int) and bool({*divmod(row[0], MAX_IMAGES)} & ours)
        if table == "frames":
            return row[0] in frames
        return table in ("images", "keypoints", "frame_data") and row[table == "frame_data"] in ours

    kept = {name: [row for row in found if not is_ours(name, row)] for name, found in rows.items()}
    return {name: sorted(found, key=repr) for name, found in kept.items() if found}


def _table_rows(database: sqlite3.Connection, table: str) -> list[tuple[Any, ...]]:
    """Return all columns of a table, those that are computed, too, whatever their names."""
    count = database.execute("SELECT count(*) FROM pragma_table_xinfo(?)", (table,)).fetchone()[0]
    columns = ", ".join(f"c{index}" for index in range(count))
    return database.execute(f'WITH t({columns}) AS (SELECT * FROM "{table}") SELECT * FROM t').fetchall()


def random_views(name: str, count: int, rng: np.random.Generator) -> ExposureViews:
    """Return views of random points with a geometry that has all of its parts."""
    first = rng.uniform(0, 60, (count, 2))
    geometry = TwoViewGeometry(
        F=rng.normal(size=(3, 3)),
        H=np.eye(3) + 0.01 * rng.normal(size=(3, 3)),
        config=Configuration.UNCALIBRATED,
        reason="drawn at random",
        inlier_mask=rng.random(count) < 0.8,
        second_end_is_open=np.zeros(count, bool),
    )
    last, time = first + rng.normal(0, 3, (count, 2)), TimeDirection(known=True, confidence=0.9)
    return ExposureViews(
        name=name, size=SIZE, points_open=first, points_close=last, sampson_px=np.full(count, 0.5),
        geometry=geometry, camera=None, time=time,
    )  # fmt: skip


def some_views(name: str = "a.jpg", count: int = 4) -> ExposureViews:
    """Return such views, the same each time, of unknown order in time."""
    return replace(random_views(name, count, np.random.default_rng(0)), time=TimeDirection())


def run_sql(path: Path, *statements: str) -> list[tuple[Any, ...]]:
    """Run statements, each committed, with foreign keys; return the rows of the last."""
    rows: list[tuple[Any, ...]] = []
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute("PRAGMA foreign_keys = ON")
        for statement in statements:
            rows = database.execute(statement).fetchall()
    return rows


NO_FRAME = (
    "SELECT 'image ' || name || ': no frame' FROM images WHERE EXISTS (SELECT 1 FROM frames) "
    "AND image_id NOT IN (SELECT data_id FROM frame_data)"
)


def check_database(path: Path) -> list[str]:
    """Return a line for everything that is wrong with a COLMAP database, which is not written.

    SQLite's own integrity and foreign keys; an image without a frame where frames are used; matches of no
    images, beyond their keypoints or that occur twice; inliers that are no matches; F, E or H not finite.
    """
    with open_read_only(path) as database:
        found = [str(row) for row in database.execute("PRAGMA integrity_check") if row != ("ok",)]
        found += [str(row) for row in database.execute("PRAGMA foreign_key_check")]
        if database.execute("SELECT 1 FROM sqlite_master WHERE name = 'frames'").fetchone():
            found += [line for (line,) in database.execute(NO_FRAME)]
        counts = dict(database.execute("SELECT image_id, rows FROM keypoints"))
        matches = dict[int, set[tuple[int, ...]]]()
        for table in ("matches", "two_view_geometries"):
            for pair, rows, data in database.execute(f"SELECT pair_id, rows, data FROM {table}"):
                indices = np.frombuffer(data or b"", "<u4").reshape(-1, 2)
                listed = set(map(tuple, indices.tolist()))
                beyond = (indices >= [counts.get(image, 0) for image in divmod(pair, MAX_IMAGES)]).any()
                if beyond or len(listed) != rows or not listed <= matches.setdefault(pair, listed):
                    found.append(f"{table} {divmod(pair, MAX_IMAGES)}")
        for pair, *blobs in database.execute("SELECT pair_id, F, E, H FROM two_view_geometries"):
            if not all(np.isfinite(np.frombuffer(blob or b"", "<f8")).all() for blob in blobs):
                found.append(f"matrices of {divmod(pair, MAX_IMAGES)}")
    return found
