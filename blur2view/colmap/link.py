"""Virtual views added to a COLMAP project that holds the photographs and their features.

Per photograph two images, their keypoints, and three pairs: photograph-open, photograph-close, open-close.
Rows of the user are read, never written.
"""

import hashlib
import sqlite3
from collections.abc import Sequence
from contextlib import ExitStack, closing
from datetime import datetime
from pathlib import Path

from blur2view.camera.colmap_camera import from_colmap
from blur2view.colmap.connection import connect, open_for_writing, open_read_only
from blur2view.colmap.database import put_views
from blur2view.colmap.project import (
    ProjectImage,
    Step,
    has_frames,
    image_names,
    longest_suffix,
    own_views,
    views_are_whole,
)
from blur2view.colmap.schema import MAX_IMAGES, VIEWS_TABLE, check_schema, read_keypoints, rig_of
from blur2view.errors import DatabaseError
from blur2view.exposure.views import CLOSE, OPEN, ExposureViews
from blur2view.output_files import half_written, remove_half_written

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


def plan_links(
    path: Path, photographs: Sequence[Path], *, replace: bool = False
) -> list[ProjectImage | DatabaseError]:
    """Return what linking will do with each photograph of a project, or why it cannot; nothing is written.

    With ``replace`` views that an earlier call wrote are written anew. DatabaseError if nothing can be read.
    """
    plan: list[ProjectImage | DatabaseError] = []
    first_of: dict[str, Path] = {}
    with open_read_only(path) as database:
        check_schema(database)
        names = image_names(database)
        for photograph in photographs:
            name = longest_suffix(names, photograph)
            if name is None:
                remedy = "leave it out, or choose another --db, without --link"
                plan.append(DatabaseError(f"{photograph}: {path} has no image of that name; {remedy}"))
            elif name in first_of:
                plan.append(DatabaseError(f"{photograph}: is {name}, as is {first_of[name]}; name it once"))
            else:
                first_of[name] = photograph
                try:
                    plan.append(_plan_one(database, names, name, replace))
                except ValueError as error:
                    plan.append(DatabaseError(f"{path}: {error}"))
    return plan


def _plan_one(database: sqlite3.Connection, names: dict[str, int], name: str, replace: bool) -> ProjectImage:
    """Return the plan for one image of the project; ValueError if there is none, with the remedy."""
    sql = (
        "SELECT image_id, camera_id, prior_focal_length, model, width, height, params "
        "FROM images LEFT JOIN cameras USING (camera_id) WHERE name = ?"
    )
    image_id, camera_id, prior, *camera = database.execute(sql, (name,)).fetchone()
    keypoints = from_colmap(read_keypoints(database, image_id))
    if not len(keypoints):
        raise ValueError(f"image {name} has no keypoints; run COLMAP's feature extraction first")
    if prior is None or (has_frames(database) and rig_of(database, camera_id) is None):
        raise ValueError(f"image {name} has no camera, or that no rig; the database is damaged")
    (data,) = database.execute("SELECT data FROM keypoints WHERE image_id = ?", (image_id,)).fetchone()
    stored = f"{camera_id} {(bool(prior), *camera)!r} ".encode("utf-8", "backslashreplace") + data
    digest, own = hashlib.sha256(stored).digest(), own_views(database, name)
    ours = {number for number, _ in own.values()}
    for view in (name + OPEN, name + CLOSE):
        if view in names and names[view] not in ours:
            raise ValueError(f"holds an image {view} that blur2view did not write; rename or delete it")
    step = Step.REPLACE if own else Step.ADD
    if own and not replace:
        sources = [source for _, source in own.values()]
        if sources != [digest] * 2 or not views_are_whole(database, image_id, ours):
            raise ValueError(f"{name} or its views are not as this call makes them; add --replace")
        step = Step.KEEP
    return ProjectImage(
        step=step,
        image_id=image_id,
        camera_id=camera_id,
        name=name,
        prior_focal=bool(prior),
        keypoints=keypoints,
        digest=digest,
    )


def write_links(
    path: Path, links: Sequence[tuple[ProjectImage, ExposureViews]], *, backup: bool = True
) -> Path | None:
    """Write planned views in one transaction; without any the file is not touched.

    Return the backup: with ``backup`` the database is copied first, as it is when the transaction begins.
    DatabaseError if the database cannot be used, or an image changed since the plan: nothing is written then.
    """
    if not links:
        return None
    with ExitStack() as undo:
        with open_for_writing(path) as database:
            check_schema(database)
            names = image_names(database)
            for image, _ in links:
                again, name = image.step is Step.REPLACE, image.name
                now = _plan_one(database, names, name, again) if name in names else None
                if now is None or (now.step, now.digest) != (image.step, image.digest):
                    raise ValueError(f"image {name} has changed meanwhile; run again")
            copy = back_up(path) if backup else None
            if copy is not None:
                undo.callback(copy.unlink)  # it equals the database if that stays as it was
            database.execute(VIEWS_TABLE)
            before = _rows_of_the_user(database)
            put_views(database, [(views, image.camera_id, image) for image, views in links])
            if _rows_of_the_user(database) != before:
                raise ValueError("would lose rows of yours; nothing is written: is it COLMAP's?")
        undo.pop_all()
    return copy


def _rows_of_the_user(database: sqlite3.Connection) -> dict[str, int]:
    """Return of every table of COLMAP's how many rows blur2view did not write, which a schema may replace."""
    tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    return {
        table: int(database.execute(f"SELECT count(*) FROM {table} WHERE {which}").fetchone()[0])
        for table, which in OF_THE_USER.items()
        if table in tables
    }


def back_up(path: Path) -> Path:
    """Copy a database, as its last transaction left it, to ``<name>.<time>.bak`` beside it."""
    copy = path.with_name(f"{path.name}.{datetime.now():%Y%m%dT%H%M%S.%f}.bak")
    beside = half_written(path)
    remove_half_written(path.parent)
    try:
        # not `open_read_only`, whose look at the header would end the lock of this process's transaction
        with closing(connect(path, "mode=ro")) as source, closing(sqlite3.connect(beside)) as target:
            target.execute("PRAGMA journal_mode = MEMORY")  # a half-written file is thrown away
            source.backup(target)
        beside.replace(copy)
    except (sqlite3.Error, OSError) as error:
        raise DatabaseError(f"{copy}: the backup cannot be written ({error}); add --no-backup") from None
    finally:
        beside.unlink(missing_ok=True)
    return copy
