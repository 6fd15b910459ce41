"""COLMAP projects that are not what they should be: each has one thing wrong, drawn from one seed.

Bytes cut, overwritten or flipped, another schema, a newer version, rows that contradict each other.
"""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from functools import partial

from blur2view.colmap.schema import MAX_IMAGES
from tools.robustness.damage import Rng, cut, flipped, overwritten

SQL_FAULTS = {
    "newer": "PRAGMA user_version = 4030000",
    "far newer": "PRAGMA user_version = 2147483647",
    "negative version": "PRAGMA user_version = -1",
    "no images": "DROP TABLE images",
    "no matches": "DROP TABLE matches",
    "no geometries": "DROP TABLE two_view_geometries",
    "no keypoints": "DROP TABLE keypoints",
    "no frame data": "DROP TABLE frame_data",
    "no rigs": "DROP TABLE rigs",
    "no rig rows": "DELETE FROM rigs",
    "no frames of the image": "DELETE FROM frame_data WHERE data_id = 2",
    "column gone": "ALTER TABLE two_view_geometries DROP COLUMN qvec",
    "column renamed": "ALTER TABLE keypoints RENAME COLUMN data TO blob",
    "column to fill": "ALTER TABLE images ADD COLUMN mark INTEGER NOT NULL DEFAULT 3",
    "columns to fill": "DROP TABLE matches; CREATE TABLE matches (pair_id INTEGER PRIMARY KEY, rows, cols, "
    "data, more INTEGER NOT NULL)",
    "view for a table": "DROP TABLE matches; CREATE VIEW matches AS SELECT image_id AS pair_id, 0 AS rows, "
    "2 AS cols, NULL AS data FROM images",
    "trigger": "CREATE TRIGGER t AFTER INSERT ON images BEGIN DELETE FROM keypoints WHERE image_id = 1; END",
    "own table of another": "CREATE TABLE blur2view_views (image_id INTEGER, note TEXT)",
    "view of our name": "INSERT INTO images VALUES (9, 'a_001.jpg#open', 1)",
    "rows too many": "UPDATE keypoints SET rows = 1000",
    "rows negative": "UPDATE keypoints SET rows = -1",
    "rows a text": "UPDATE keypoints SET rows = 'many'",
    "rows huge": "UPDATE keypoints SET rows = 9223372036854775807",
    "columns odd": "UPDATE keypoints SET cols = 3",
    "columns NULL-like": "UPDATE keypoints SET cols = ''",
    "keypoints a text": "UPDATE keypoints SET data = 'none'",
    "keypoints gone": "UPDATE keypoints SET data = NULL",
    "keypoint rows gone": "DELETE FROM keypoints",
    "no keypoints found": "UPDATE keypoints SET rows = 0, data = NULL",
    "keypoints not finite": "UPDATE keypoints SET data = zeroblob(0) || x'0000C07F' || substr(data, 5)",
    "keypoints infinite": "UPDATE keypoints SET data = CAST(x'0000807F0000807F' || substr(data, 9) AS BLOB)",
    "keypoints far away": "UPDATE keypoints SET data = CAST(x'FFFF7F7FFFFF7FFF' || substr(data, 9) AS BLOB)",
    "camera gone": "DELETE FROM cameras",
    "camera a text": "UPDATE images SET camera_id = 'front'",
    "camera unknown": "UPDATE cameras SET model = 99",
    "camera model a text": "UPDATE cameras SET model = 'PINHOLE'",
    "camera short": "UPDATE cameras SET params = x'00'",
    "camera without parameters": "UPDATE cameras SET params = NULL",
    "camera parameters a text": "UPDATE cameras SET params = 'f'",
    "camera of another size": "UPDATE cameras SET width = 640",
    "camera of no size": "UPDATE cameras SET width = -1",
    "camera not finite": f"UPDATE cameras SET params = x'{4 * '000000000000F87F'}'",
    "prior a text": "UPDATE cameras SET prior_focal_length = 'yes'",
    "name a blob": "UPDATE images SET name = x'00FF' WHERE image_id = 3",
    "name no UTF-8": "UPDATE images SET name = CAST(x'612FFFFE' AS TEXT) WHERE image_id = 3",
    "name empty": "UPDATE images SET name = '' WHERE image_id = 3",
    "own name a blob": "UPDATE images SET name = CAST(name AS BLOB)",
    "name with a null": "UPDATE images SET name = CAST(x'615f3030312e6a70670078' AS TEXT) WHERE image_id = 2",
    "name very long": "UPDATE images SET name = CAST(zeroblob(99999) AS TEXT) || 'x' WHERE image_id = 3",
    "name a long text": f"UPDATE images SET name = '{'x' * 5000}' WHERE image_id = 3",
    "name an integer": "DROP TABLE images; CREATE TABLE images (image_id INTEGER PRIMARY KEY, name, "
    "camera_id); INSERT INTO images VALUES (2, 'a_001.jpg', 1), (3, 7, 1)",
    "view a blob": "INSERT INTO images VALUES (9, CAST('a_001.jpg#open' AS BLOB), 1)",
    "view with a null": "INSERT INTO images VALUES (9, CAST(x'615f3030312e6a7067236f70656e00' AS TEXT), 1)",
    "names of any case": "DROP TABLE images; CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT "
    "UNIQUE COLLATE NOCASE, camera_id); "
    "INSERT INTO images VALUES (2, 'a_001.jpg', 1), (3, 'A_001.jpg#OPEN', 1)",
    "replacing keypoints": "DROP TABLE keypoints; CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, "
    "rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB, UNIQUE(cols) ON CONFLICT REPLACE); "
    "INSERT INTO keypoints VALUES (2, 40, 4, zeroblob(640)), (3, 40, 2, zeroblob(320))",
    "unique keypoints": "CREATE UNIQUE INDEX few ON keypoints(cols) WHERE image_id > 3",
    "unique sums": "CREATE UNIQUE INDEX sums ON keypoints(rows + image_id)",
    "computed column": "ALTER TABLE keypoints ADD COLUMN twice AS (2 * rows)",
    "checked column": "ALTER TABLE matches ADD COLUMN odd INTEGER CHECK (pair_id % 2)",
    "no row ids": "DROP TABLE matches; CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, "
    "rows INTEGER, cols INTEGER, data BLOB) WITHOUT ROWID",
    "camera infinitely wide": "UPDATE cameras SET width = 9e999",
    "last id": f"INSERT INTO images VALUES ({MAX_IMAGES - 1}, 'last.jpg', 1)",
    "pair taken": f"INSERT INTO matches VALUES ({MAX_IMAGES * 2 + 4}, 0, 2, NULL)",
    "geometry taken": f"INSERT INTO two_view_geometries(pair_id, rows, cols, config) VALUES "
    f"({MAX_IMAGES * 4 + 5}, 0, 2, 1)",
    "keypoints taken": "INSERT INTO keypoints VALUES (4, 0, 2, NULL)",
    "frame taken": "INSERT INTO frame_data VALUES (1, 4, 1, 0)",
    "matches dangling": f"INSERT INTO matches VALUES ({MAX_IMAGES * 70 + 80}, 1, 2, x'00')",
    "matches odd": "UPDATE matches SET data = x'0102', rows = 77",
    "geometry odd": "UPDATE two_view_geometries SET data = 'x', rows = 'y', config = 88",
    "counter gone": "DELETE FROM sqlite_sequence",
    "counter a text": "UPDATE sqlite_sequence SET seq = 'many'",
    "counter at its end": "UPDATE sqlite_sequence SET seq = 9223372036854775807",
    "all empty": "DELETE FROM images; DELETE FROM cameras; DELETE FROM keypoints",
}


def page_of_zeros(data: bytes, rng: Rng) -> bytes:
    """Return a database of which a page holds zeros."""
    page = 4096 * int(rng.integers(0, len(data) // 4096))
    return data[:page] + bytes(4096) + data[page + 4096 :]


def no_database(_: bytes, rng: Rng) -> bytes:
    """Return something else: nothing, a text, noise, another program's database."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute("CREATE TABLE images (id INTEGER PRIMARY KEY, path TEXT)")
        database.execute("INSERT INTO images VALUES (1, 'a_001.jpg')")
        database.commit()
        others = database.serialize()
    kind = int(rng.integers(0, 4))
    return [b"", b"cameras.txt\n" * 50, rng.bytes(9000), others][kind]


BYTE_FAULTS: dict[str, Callable[[bytes, Rng], bytes]] = {
    "cut": cut,
    "overwritten": partial(overwritten, longest=5000),
    "bytes flipped": partial(flipped, most=30),
    "header flipped": lambda data, rng: flipped(data, rng, 6, (0, int(rng.choice([100, 4096])))),
    "page of zeros": page_of_zeros,
    "no database": no_database,
}
