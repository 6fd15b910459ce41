"""A check of a COLMAP database beyond what SQLite and pycolmap enforce."""

from pathlib import Path

import numpy as np

from blur2view.colmap.project import MAX_IMAGES, open_read_only

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
