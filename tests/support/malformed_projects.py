"""COLMAP projects that are not what they should be: another schema, a newer version, rows that contradict."""

from blur2view.colmap.schema import MAX_IMAGES

SQL_FAULTS = {
    "newer": "PRAGMA user_version = 4030000",
    "no images": "DROP TABLE images",
    "no matches": "DROP TABLE matches",
    "column gone": "ALTER TABLE two_view_geometries DROP COLUMN qvec",
    "column renamed": "ALTER TABLE keypoints RENAME COLUMN data TO blob",
    "columns to fill": "DROP TABLE matches; CREATE TABLE matches (pair_id INTEGER PRIMARY KEY, rows, cols, "
    "data, more INTEGER NOT NULL)",
    "view for a table": "DROP TABLE matches; CREATE VIEW matches AS SELECT image_id AS pair_id, 0 AS rows, "
    "2 AS cols, NULL AS data FROM images",
    "trigger": "CREATE TRIGGER t AFTER INSERT ON images BEGIN DELETE FROM keypoints WHERE image_id = 1; END",
    "own table of another": "CREATE TABLE blur2view_views (image_id INTEGER, note TEXT)",
    "view of our name": "INSERT INTO images VALUES (9, 'a_001.jpg#open', 1)",
    "rows too many": "UPDATE keypoints SET rows = 1000",
    "keypoints gone": "UPDATE keypoints SET data = NULL",
    "keypoints not finite": "UPDATE keypoints SET data = zeroblob(0) || x'0000C07F' || substr(data, 5)",
    "camera gone": "DELETE FROM cameras",
    "camera unknown": "UPDATE cameras SET model = 99",
    "name a blob": "UPDATE images SET name = x'00FF' WHERE image_id = 3",
    "name very long": "UPDATE images SET name = CAST(zeroblob(99999) AS TEXT) || 'x' WHERE image_id = 3",
    "names of any case": "DROP TABLE images; CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT "
    "UNIQUE COLLATE NOCASE, camera_id); "
    "INSERT INTO images VALUES (2, 'a_001.jpg', 1), (3, 'A_001.jpg#OPEN', 1)",
    "replacing keypoints": "DROP TABLE keypoints; CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, "
    "rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB, UNIQUE(cols) ON CONFLICT REPLACE); "
    "INSERT INTO keypoints VALUES (2, 40, 4, zeroblob(640)), (3, 40, 2, zeroblob(320))",
    "unique sums": "CREATE UNIQUE INDEX sums ON keypoints(rows + image_id)",
    "no row ids": "DROP TABLE matches; CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, "
    "rows INTEGER, cols INTEGER, data BLOB) WITHOUT ROWID",
    "last id": f"INSERT INTO images VALUES ({MAX_IMAGES - 1}, 'last.jpg', 1)",
    "matches odd": "UPDATE matches SET data = x'0102', rows = 77",
    "counter at its end": "UPDATE sqlite_sequence SET seq = 9223372036854775807",
    "all empty": "DELETE FROM images; DELETE FROM cameras; DELETE FROM keypoints",
}
