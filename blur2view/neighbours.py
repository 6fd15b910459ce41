"""Matched pixels of neighbouring photographs: found by OpenCV, or read from a COLMAP database."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.colmap import from_colmap
from blur2view.errors import DatabaseError
from blur2view.image import read_image

Array = NDArray[np.float64]
Features = tuple[Array, NDArray[np.float32]]  # points (N, 2), descriptors (N, 128)

MAX_SIDE = 640  # pictures are matched at no more pixels: blurred ones show no more in more
MAX_FEATURES = 4000  # with 1000 the rotation of 94 % of RedKitchen's frames came out right instead of 100 %
FAINT = 0.01  # SIFT's contrast threshold: blurred pictures have little
RATIO = 0.8  # best over second best distance (Lowe 2004)
MAX_ERROR_PX = 2.0  # of the epipolar geometry that verifies them
FEWEST = 12  # verified matches; fewer may be chance
PAIR_BASE = 2147483647  # COLMAP: pair_id = PAIR_BASE * smaller image_id + larger
NONE = np.zeros((0, 2))


class PhotographMatcher:
    """Matches photographs by SIFT, mutual nearest neighbours and an epipolar check.

    Parameters
    ----------
    paths : sequence of Path
        The photographs; each is read when it is first needed, the features of a few are kept.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._features = lru_cache(maxsize=8)(lambda index: detect(grey_photograph(paths[index])))

    def __call__(self, first: int, second: int) -> tuple[Array, Array]:
        """Give matched pixels (M, 2) of two photographs by their indices, none where they show too little."""
        return match_features(self._features(first), self._features(second))


def grey_photograph(path: Path) -> NDArray[np.uint8]:
    """Read a photograph as (H, W) uint8, as it is stored, in which COLMAP's pixels are.

    Raises
    ------
    ImageError
        If it cannot be read.
    """
    grey = cv2.cvtColor(read_image(path, as_stored=True), cv2.COLOR_RGB2GRAY)
    return np.asarray(np.rint(255 * grey), np.uint8)


def detect(grey: NDArray[np.uint8]) -> Features:
    """Find SIFT features of a picture (H, W): pixels (N, 2) of the picture as given, and descriptors."""
    scale = min(1.0, MAX_SIDE / max(grey.shape))
    if scale < 1:
        grey = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    # without the last option OpenCV's features lie a quarter of a pixel off
    sift = cv2.SIFT.create(MAX_FEATURES, contrastThreshold=FAINT, enable_precise_upscale=True)
    found, descriptors = sift.detectAndCompute(grey, None)
    if not found:
        return NONE, np.zeros((0, 128), np.float32)
    points = (np.array([feature.pt for feature in found]) + 0.5) / scale - 0.5
    return points, np.asarray(descriptors, np.float32)


def match_features(one: Features, other: Features) -> tuple[Array, Array]:
    """Match mutual nearest neighbours that pass the ratio test; keep what one epipolar geometry explains."""
    (points1, descriptors1), (points2, descriptors2) = one, other
    if min(len(points1), len(points2)) < FEWEST:
        return NONE, NONE
    similarity = unit(descriptors1) @ unit(descriptors2).T
    best, back = similarity.argmax(axis=1), similarity.argmax(axis=0)
    rows = np.arange(len(best))
    near = np.sqrt(np.maximum(2 - 2 * similarity[rows, best], 0))
    similarity[rows, best] = -np.inf
    second = np.sqrt(np.maximum(2 - 2 * similarity.max(axis=1), 0))
    chosen = np.flatnonzero((near < RATIO * second) & (back[best] == rows))
    if len(chosen) < FEWEST:
        return NONE, NONE
    return verified(points1[chosen], points2[best[chosen]])


def unit(descriptors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Scale descriptors (N, 128) to length 1, so that their products give their distances."""
    length = np.linalg.norm(descriptors, axis=1, keepdims=True)
    return np.asarray(descriptors / np.maximum(length, 1e-6), np.float32)


def verified(points1: Array, points2: Array) -> tuple[Array, Array]:
    """Keep the matches (M, 2) within MAX_ERROR_PX of one epipolar geometry, at the size of matching."""
    bound = MAX_ERROR_PX * max(1.0, float(max(points1.max(), points2.max())) / MAX_SIDE)
    _, inliers = cv2.findFundamentalMat(points1, points2, cv2.USAC_MAGSAC, bound, 0.999, 2000)
    if inliers is None or inliers.sum() < FEWEST:
        return NONE, NONE
    kept = inliers.ravel().astype(bool)
    return points1[kept], points2[kept]


class DatabaseMatcher:
    """Matches of a COLMAP database, verified ones where it has them.

    Parameters
    ----------
    path : Path
        The database; it is opened for each pair and only read.
    names : sequence of str
        Of the photographs, as the database has them.
    """

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        self._path, self._names = path, names

    def __call__(self, first: int, second: int) -> tuple[Array, Array]:
        """Give matched pixels (M, 2) of two photographs by their indices, none where it has none.

        Raises
        ------
        DatabaseError
            If the database cannot be read.
        """
        try:
            with closing(_opened(self._path)) as database:
                return _database_matches(database, self._names[first], self._names[second])
        except (sqlite3.Error, TypeError, ValueError) as error:
            raise DatabaseError(
                f"{self._path}: matches cannot be read ({error}); is it a COLMAP database?"
            ) from None


def database_names(path: Path) -> list[str]:
    """Names of a COLMAP database's images, by their ids; those that are no UTF-8 are left out.

    Raises
    ------
    DatabaseError
        If the database cannot be read.
    """
    try:
        with closing(_opened(path)) as database:
            database.text_factory = lambda name: name.decode() if _is_text(name) else name
            rows = database.execute("SELECT name FROM images ORDER BY image_id").fetchall()
    except (sqlite3.Error, UnicodeError) as error:
        raise DatabaseError(f"{path}: images cannot be read ({error}); is it a COLMAP database?") from None
    return [name for (name,) in rows if isinstance(name, str)]


def _is_text(name: bytes) -> bool:
    """Whether bytes are UTF-8."""
    return name.decode("utf-8", "ignore").encode() == name


def _opened(path: Path) -> sqlite3.Connection:
    # for writing, which is not done: a read-only connection leaves the files of a write-ahead log behind
    return sqlite3.connect(f"{path.resolve().as_uri()}?mode=rw", uri=True, timeout=2)


def _database_matches(database: sqlite3.Connection, name1: str, name2: str) -> tuple[Array, Array]:
    id1, id2 = (_image_id(database, name) for name in (name1, name2))
    if id1 is None or id2 is None or id1 == id2:
        return NONE, NONE
    index = _pair_rows(database, PAIR_BASE * min(id1, id2) + max(id1, id2))
    index = index if id1 < id2 else index[:, ::-1]  # COLMAP's pairs begin with the smaller id
    points1, points2 = _keypoints(database, id1), _keypoints(database, id2)
    inside = (index[:, 0] < len(points1)) & (index[:, 1] < len(points2))
    return points1[index[inside, 0]], points2[index[inside, 1]]


def _image_id(database: sqlite3.Connection, name: str) -> int | None:
    row = database.execute("SELECT image_id FROM images WHERE name = ?", (name,)).fetchone()
    return None if row is None else int(row[0])


def _pair_rows(database: sqlite3.Connection, pair_id: int) -> NDArray[np.uint32]:
    """Give the indices (M, 2) of a pair's inliers, or of its matches where none were verified."""
    for table in ("two_view_geometries", "matches"):
        row = database.execute(f"SELECT data FROM {table} WHERE pair_id = ?", (pair_id,)).fetchone()
        if row is not None and row[0]:
            return np.frombuffer(row[0], np.uint32).reshape(-1, 2)
    return np.zeros((0, 2), np.uint32)


def _keypoints(database: sqlite3.Connection, image_id: int) -> Array:
    """Give our pixels (N, 2) of an image's keypoints."""
    query = "SELECT rows, cols, data FROM keypoints WHERE image_id = ?"
    row = database.execute(query, (image_id,)).fetchone()
    if row is None or not row[2]:
        return NONE
    return from_colmap(np.frombuffer(row[2], np.float32).reshape(row[0], row[1])[:, :2].astype(float))
