"""COLMAP projects that are not what they should be: another schema, a newer version, rows that contradict."""

from blur2view.colmap.project import MAX_IMAGES

SQL_FAULTS = {
    "newer": "PRAGMA user_version = 4030000",
    "no images": "DROP TABLE images",
    "column renamed": "ALTER TABLE keypoints RENAME COLUMN data TO blob",
    "view for a table": "DROP TABLE matches; CREATE VIEW matches AS SELECT image_id AS pair_id, 0 AS rows, "
    "2 AS cols, NULL AS data FROM images",
    "trigger": "CREATE TRIGGER t AFTER INSERT ON images BEGIN DELETE FROM keypoints WHERE image_id = 1; END",
    "own table of another": "CREATE TABLE blur2view_views (image_id INTEGER, note TEXT)",
    "view of our name": "INSERT INTO images VALUES (9, 'a_001.jpg#open', 1)",
    "rows too many": "UPDATE keypoints SET rows = 1000",
    "keypoints not finite": "UPDATE keypoints SET data = zeroblob(0) || x'0000C07F' || substr(data, 5)",
    "camera unknown": "UPDATE cameras SET model = 99",
    "name a blob": "UPDATE images SET name = x'00FF' WHERE image_id = 3",
    "replacing keypoints": "DROP TABLE keypoints; CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, "
    "rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB, UNIQUE(cols) ON CONFLICT REPLACE); "
    "INSERT INTO keypoints VALUES (2, 40, 4, zeroblob(640)), (3, 40, 2, zeroblob(320))",
    "last id": f"INSERT INTO images VALUES ({MAX_IMAGES - 1}, 'last.jpg', 1)",
    "counter at its end": "UPDATE sqlite_sequence SET seq = 9223372036854775807",
    "all empty": "DELETE FROM images; DELETE FROM cameras; DELETE FROM keypoints",
}
