"""COLMAP's models in folders: found, read and written whole, and what project.ini says about them."""

import os
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.arrays import Array
from blur2view.camera import NO_RAYS
from blur2view.colmap.project import CAMERA_SENSOR, MAX_FRAMES, has_frames, image_names, open_read_only
from blur2view.errors import DatabaseError, OutputError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.files import file_digest, open_regular, read_regular
from blur2view.output import half_written, is_noted, locked, note, writable_folder

# Bytes of a record before the number of its parts, but for an image's name, of that number, and of a part;
# of cameras and rigs those of the smallest record.
RECORDS = {
    "rigs.bin": (8, 0, 0),
    "cameras.bin": (40, 0, 0),
    "frames.bin": (64, 4, 16),
    "images.bin": (64, 8, 24),
    "points3D.bin": (43, 8, 8),
}
NUMBER_OF_POINTS = re.compile(rb"# Number of points: (\d{1,18})\b")  # in the head of points3D.txt
PROJECT_FILE = "project.ini"  # as COLMAP writes beside a model
SIGNATURE = "# by blur2view"
PICTURES, DATABASE = "image_path", "database_path"  # keys of project.ini
MAX_VALUE = 1e30  # of any number in a model (bound)
MAX_PROJECT_BYTES = 1 << 20  # of project.ini (bound)
SPARE_BYTES = 1 << 20  # that must be left on a disk that was not full


@dataclass(frozen=True, kw_only=True)
class DatabaseIds:
    """The ids of a database's images, and of their frames, by the images' names."""

    images: Mapping[str, int]
    frames: Mapping[str, int]


def read_ids(path: Path) -> DatabaseIds:
    """Return the ids of a database; DatabaseError if it cannot be read."""
    with open_read_only(path) as database:
        images = image_names(database)
        data = {}
        if has_frames(database):
            sql = f"SELECT data_id, frame_id FROM frame_data WHERE sensor_type = {CAMERA_SENSOR}"
            data = dict(database.execute(sql).fetchall())
    frames = {name: data[number] for name, number in images.items() if number in data}
    return DatabaseIds(images=_possible(images), frames=_possible(frames))


def _possible(ids: Mapping[str, Any]) -> dict[str, int]:
    """Return those ids that COLMAP can hold: rows may have anything."""
    return {
        name: number for name, number in ids.items() if isinstance(number, int) and 0 < number < MAX_FRAMES
    }


def read_model(folder: Path) -> Any:
    """Return the pycolmap.Reconstruction of a folder; DatabaseError if files are missing, cut or damaged."""
    import pycolmap

    if not holds_model(folder):
        remedy = "name the folder with cameras.bin, images.bin and points3D.bin"
        said = "has no COLMAP model" if folder.exists() else "no such folder"
        raise DatabaseError(f"{folder}: {said}; {remedy}")
    try:
        for name in RECORDS:
            if (folder / name).exists():
                _check_records(folder / name)
        if not (folder / "cameras.bin").exists():  # else COLMAP reads the binary files
            _check_number_of_points(folder / "points3D.txt")
        model = pycolmap.Reconstruction(folder)
        cameras, file = [camera.params for camera in model.cameras.values()], folder / "cameras.bin"
        if file.exists() and file.stat().st_size < 8 + sum(24 + 8 * len(params) for params in cameras):
            raise ValueError("cameras.bin ends within a record")
        for camera in model.cameras.values():
            if min(camera.width, camera.height, *camera.params[camera.focal_length_idxs()]) <= 0:
                raise ValueError(f"camera {camera.camera_id} has no positive size and focal length")
        posed = [image for image in model.images.values() if image.name and image.has_pose]
        numbers = [*cameras, *(point.xyz for point in model.points3D.values())]
        numbers += [image.cam_from_world().matrix().ravel() for image in posed]
        if not (np.abs(np.concatenate([np.zeros(0), *numbers])) < MAX_VALUE).all():  # False of NaN
            raise ValueError("holds values that are not finite")
    except (OSError, ValueError, RuntimeError, LookupError, MemoryError) as error:
        why = " ".join(str(error).split()).rpartition("] ")[2] or type(error).__name__
        raise DatabaseError(f"{folder}: its model is damaged ({why}); let COLMAP write it again") from None
    if refused := sorted({camera.model_name for camera in model.cameras.values()} & {*NO_RAYS}):
        raise DatabaseError(f"{folder}: its camera {refused[0]} has no rays in a plane; map pinhole pictures")
    return model


def _check_records(path: Path) -> None:
    """Raise ValueError if a file ends within a record, where pycolmap reads on and may take all memory."""
    with open_regular(path) as file:
        content = file.read()
    before, number, part = RECORDS[path.name]
    at, count = 8, int.from_bytes(content[:8], "little")
    while count and at <= len(content):
        at += before
        if path.name == "images.bin":
            end_of_name = content.find(b"\0", at)
            at = len(content) + 1 if end_of_name < 0 else end_of_name + 1
        at += number + part * int.from_bytes(content[at : at + number], "little")
        count -= 1
    if at > len(content):
        raise ValueError(f"{path.name} ends within a record")


def _check_number_of_points(path: Path) -> None:
    """Raise ValueError if a file has fewer points than its head says: it was cut between two lines.

    pycolmap refuses the other files where they are cut.
    """
    with open_regular(path) as file:
        lines = file.read().splitlines()
    head = [line for line in lines if line.startswith(b"#")]
    stated_counts = [int(match[1]) for line in head if (match := NUMBER_OF_POINTS.match(line))]
    count = sum(bool(line) for line in lines) - len(head)
    if stated_counts and count < stated_counts[0]:
        raise ValueError(f"{path.name} states {stated_counts[0]} points and has {count}")


def find_model(folder: Path, pass_over: Callable[[DatabaseError], None] = lambda error: None) -> Path:
    """Return the model in a folder, or the largest of those that a mapper has written below it, 0, 1, ...

    Damaged ones are passed over unless all are; ``pass_over`` gets the error of each.
    """
    below = sorted(path for path in folder.iterdir() if holds_model(path)) if folder.is_dir() else []
    if holds_model(folder) or not below:
        return folder
    sizes, damaged = dict[Path, int](), list[DatabaseError]()
    for path in below:
        try:
            sizes[path] = len(registered_images(read_model(path)))
        except DatabaseError as error:
            damaged.append(error)
    if not sizes:
        return below[0]
    for defect in damaged:
        pass_over(DatabaseError(f"{defect}; it is passed over"))
    return max(sizes, key=lambda path: sizes[path])


def holds_model(folder: Path) -> bool:
    """Return whether a folder holds a model."""
    return any((folder / f"cameras.{suffix}").is_file() for suffix in ("bin", "txt"))


def registered_images(model: Any) -> dict[str, Any]:
    """Return the registered images of a pycolmap.Reconstruction by name, views left out."""
    posed = {image.name: image for image in model.images.values() if image.has_pose}
    return {name: image for name, image in posed.items() if not name.endswith((OPEN, CLOSE))}


def observed(model: Any, image: Any) -> dict[int, int]:
    """Return the ids of the 3D points that an image observes, by the indices of its keypoints."""
    point_ids = {index: point.point3D_id for index, point in enumerate(image.points2D) if point.has_point3D()}
    return {index: number for index, number in point_ids.items() if number in model.points3D}


def add_image(
    model: Any, name: str, pose: Array, keypoints: Array, beside: Any, ids: DatabaseIds | None = None
) -> Any:
    """Return a new image at a pose (3, 4), with keypoints (N, 2) and the camera of the image ``beside``.

    It has the ``ids`` that a database has for this name, or, as its frame, ids that neither has.
    """
    import pycolmap

    camera_id = beside.camera_id
    ids = ids or DatabaseIds(images={}, frames={})
    number, frame_id = ids.images.get(name), ids.frames.get(name)
    if number is None or number in model.images:
        number = 1 + max([*model.images, *ids.images.values()])
    if frame_id is None or frame_id in model.frames:
        frame_id = 1 + max([*model.frames, *ids.frames.values()])
    image = pycolmap.Image(name=name, keypoints=keypoints, camera_id=camera_id, image_id=number)
    image.frame_id = frame_id
    frame = pycolmap.Frame(frame_id=image.frame_id, rig_id=beside.frame.rig_id)
    frame.add_data_id(image.data_id)
    model.add_frame(frame)
    model.add_image(image)
    model.frame(image.frame_id).set_cam_from_world(camera_id, pycolmap.Rigid3d(pose))
    model.register_frame(image.frame_id)
    return model.images[number]


def set_pose(model: Any, name: str, pose: Array) -> None:
    """Set the pose (3, 4) of an image that a model has."""
    import pycolmap

    image = model.find_image_with_name(name)
    model.frame(image.frame_id).set_cam_from_world(image.camera_id, pycolmap.Rigid3d(pose))


def refuse_other_model(folder: Path, source: Path) -> None:
    """Refuse, before any work, to write a model where one is lost that blur2view did not write as it is.

    OutputError if a folder is that of the model ``source``, or holds a file of a model that another program
    wrote, or changed since, or one in text, which COLMAP would no longer read beside the binary files.
    """
    remedy = "move it away, or name another folder with -o"
    if os.path.realpath(folder) == os.path.realpath(source):
        raise OutputError(f"{folder}: would replace the model of this call; name another folder with -o")
    texts = [Path(name).with_suffix(".txt").name for name in RECORDS]
    present = [folder / name for name in (*RECORDS, PROJECT_FILE, *texts) if os.path.lexists(folder / name)]
    if present and not _project(folder).startswith(SIGNATURE):
        raise OutputError(f"{present[0]}: was not written by an earlier call; {remedy}")
    for path in present:
        if path.suffix == ".txt" or is_noted(path) is False:
            raise OutputError(f"{path}: has changed since blur2view wrote the model; {remedy}")


def write_model(model: Any, folder: Path, frames_dir: Path, database: Path | None = None) -> None:
    """Write a model and COLMAP's project.ini whole, in place of earlier ones; OutputError if it fails."""
    paths = {PICTURES: frames_dir} | ({} if database is None else {DATABASE: database})
    lines = [SIGNATURE, *(f"{key}={path.absolute()}" for key, path in paths.items())]
    writable_folder(folder)
    beside = half_written(folder / "model")
    try:
        beside.mkdir(parents=True)
        model.write(beside)
        (beside / "room").write_bytes(bytes(SPARE_BYTES))  # pycolmap does not say that a disk is full
        (beside / PROJECT_FILE).write_bytes(os.fsencode("\n".join(lines) + "\n"))
        with locked(folder):
            note({folder / name: file_digest(beside / name) for name in RECORDS})
            for name in (PROJECT_FILE, *RECORDS):  # first what says whose they are, if it is killed here
                (beside / name).replace(folder / name)
    except (OSError, ValueError, RuntimeError) as error:
        why = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise OutputError(
            f"{folder}: the model cannot be written there ({why}); free some space, or name another folder"
        ) from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def noted(folder: Path, key: str) -> Path | None:
    """Return the path under a key of a model's project.ini; None unless it is there and exists."""
    lines = (line.partition("=") for line in _project(folder).splitlines())
    path = next((value.strip() for name, _, value in lines if name.strip() == key), "")
    return Path(path) if path and os.path.exists(path) else None


def _project(folder: Path) -> str:
    """Return the text of a model's project.ini, empty without one."""
    try:
        return os.fsdecode(read_regular(folder / PROJECT_FILE, MAX_PROJECT_BYTES))
    except OSError:
        return ""
