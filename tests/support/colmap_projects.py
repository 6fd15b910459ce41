"""Small COLMAP projects as a user may have them, to test what we write into them."""

import sqlite3
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from blur2view import Configuration, ExposureViews, TimeDirection, TwoViewGeometry
from blur2view.colmap.project import MAX_IMAGES, open_read_only
from tests.support.walks import Walk

SIZE = (96, 64)
NO_FRAMES = "DELETE FROM frame_data; DELETE FROM frames; DELETE FROM rigs;"
OLD = """
DROP TABLE frame_data; DROP TABLE frames; DROP TABLE rig_sensors; DROP TABLE rigs; DROP TABLE pose_priors;
ALTER TABLE images ADD COLUMN prior_qw REAL; ALTER TABLE descriptors DROP COLUMN type;
ALTER TABLE two_view_geometries DROP COLUMN camera1; ALTER TABLE two_view_geometries DROP COLUMN camera2;
PRAGMA user_version = 3900;
"""

Rows = dict[str, list[tuple[Any, ...]]]


@dataclass(frozen=True, kw_only=True)
class ProjectOptions:
    """``images`` photographs "a_000.jpg", ... with ``features`` keypoints each, matched with all others.

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
    walk = Walk(names=names, size=o.size, focal=1.1 * o.size[0], turn=np.zeros(3), move=np.array([0.1, 0, 0]))
    walk.write(rng.uniform([-1, -0.6, 4], [1, 0.6, 8], (o.features, 3)), path, {})
    with closing(sqlite3.connect(path)) as database:
        database.executescript(OLD if o.old else "" if o.frames else NO_FRAMES)
        database.execute(f"PRAGMA journal_mode = {'WAL' if o.wal else 'DELETE'}")
    return names


def user_rows(path: Path) -> Rows:
    """Return the rows of all tables that blur2view did not write, but for SQLite's own counters of ids."""
    with closing(sqlite3.connect(path)) as database:
        database.text_factory = bytes
        sql = "SELECT CAST(name AS BLOB) FROM sqlite_master WHERE type = 'table'"
        names = [name.decode() for (name,) in database.execute(sql)]
        rows = {name: database.execute(f'SELECT * FROM "{name}"').fetchall() for name in names}
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


def random_views(name: str, count: int, rng: np.random.Generator) -> ExposureViews:
    """Return views of random points with a geometry that has all of its parts."""
    first = rng.uniform(0, 60, (count, 2))
    geometry = TwoViewGeometry(
        F=rng.normal(size=(3, 3)),
        H=np.eye(3) + 0.01 * rng.normal(size=(3, 3)),
        config=Configuration.UNCALIBRATED,
        inlier_mask=rng.random(count) < 0.8,
        second_end_is_open=np.zeros(count, bool),
    )
    last, time = first + rng.normal(0, 3, (count, 2)), TimeDirection(known=True, confidence=0.9)
    return ExposureViews(
        name=name, size=SIZE, points_open=first, points_close=last, sampson_px=np.full(count, 0.5),
        geometry=geometry, camera=None, time=time,
    )  # fmt: skip


def some_views(name: str = "a.jpg", count: int = 4) -> ExposureViews:
    """Return random views, the same each time, of unknown order in time."""
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
