"""COLMAP's models in folders: read by pycolmap, found, written whole, and the pictures that one is of."""

import mmap
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.arrays import Array
from blur2view.errors import DatabaseError, OutputError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.files import open_regular, read_regular, writable_folder

FILES = ("rigs.bin", "cameras.bin", "frames.bin", "images.bin", "points3D.bin")
PROJECT_FILE = "project.ini"  # as COLMAP writes beside a model
SIGN = "# by blur2view"
PICTURES, DATABASE = "image_path", "database_path"  # its keys
BEYOND = 1e30  # of any number in a model
MAX_PROJECT = 1 << 20  # bytes
ROOM = 1 << 20  # bytes that must be left on a disk that was not full
# Of a record: bytes before the number of its parts, but for a name; those of that number; of a part.
RECORDS = {"images.bin": (64, 8, 24), "points3D.bin": (43, 8, 8), "frames.bin": (64, 4, 16)}


def read_model(folder: Path) -> Any:
    """Return the pycolmap.Reconstruction of a folder; DatabaseError of one that is not whole."""
    import pycolmap

    if not holds_model(folder):
        remedy = "name the folder with cameras.bin, images.bin and points3D.bin"
        raise DatabaseError(f"{folder}: holds no model of COLMAP's; {remedy}")
    try:
        for path in folder.iterdir():
            if path.suffix in (".bin", ".txt"):
                _check_file(path)
        model = pycolmap.Reconstruction(folder)
        posed = [image for image in model.images.values() if image.name and image.has_pose]
        numbers = [camera.params for camera in model.cameras.values()]
        numbers += [point.xyz for point in model.points3D.values()]
        numbers += [image.cam_from_world().matrix().ravel() for image in posed]
        if not (np.abs(np.concatenate([np.zeros(0), *numbers])) < BEYOND).all():  # False of NaN
            raise ValueError("holds values that are not finite")
        return model
    except (OSError, ValueError, RuntimeError, LookupError, MemoryError) as error:
        why = " ".join(str(error).split()).rpartition("] ")[2] or type(error).__name__
        raise DatabaseError(f"{folder}: its model is damaged ({why}); let COLMAP write it again") from None


def _check_file(path: Path) -> None:
    """Raise ValueError of a file that ends within a record: pycolmap reads on, or takes all memory."""
    with open_regular(path) as file:
        count, size = int.from_bytes(file.read(8), "little"), path.stat().st_size
        whole = path.suffix != ".bin" or size >= max(count, 8)
        if whole and path.name in RECORDS:
            before, number, part = RECORDS[path.name]
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                at = 8
                for _ in range(count):
                    at += before
                    if path.name == "images.bin":
                        at = content.find(b"\0", at) + 1 or size + 1  # behind the name
                    at += number + part * int.from_bytes(content[at : at + number], "little")
                    if at > size:
                        break
                whole = at <= size
        if not whole:
            raise ValueError(f"{path.name} ends within a record")


def find_model(folder: Path) -> Path:
    """Return the model in a folder, or the largest of those that a mapper has written below it, 0, 1, ..."""
    below = sorted(path for path in folder.iterdir() if holds_model(path)) if folder.is_dir() else []
    if holds_model(folder) or not below:
        return folder
    return max(below, key=lambda path: len(photographs_of(read_model(path))))


def holds_model(folder: Path) -> bool:
    """Return whether there are files of a model in a folder."""
    return any((folder / f"cameras.{suffix}").is_file() for suffix in ("bin", "txt"))


def photographs_of(model: Any) -> dict[str, Any]:
    """Return the registered images of a pycolmap.Reconstruction by name, views left out."""
    posed = {image.name: image for image in model.images.values() if image.has_pose}
    return {name: image for name, image in posed.items() if not name.endswith((OPEN, CLOSE))}


def observed(model: Any, image: Any) -> dict[int, int]:
    """Return the ids of the 3D points that an image observes by the places of its keypoints."""
    seen = {place: point.point3D_id for place, point in enumerate(image.points2D) if point.has_point3D()}
    return {place: number for place, number in seen.items() if number in model.points3D}


def add_image(
    model: Any, name: str, pose: Array, keypoints: Array, beside: Any, wanted_id: int | None = None
) -> Any:
    """Return a new image at a pose (3, 4), with keypoints (N, 2) and the camera of another one ``beside``."""
    import pycolmap

    camera_id = beside.camera_id
    number = 1 + max(model.images) if wanted_id is None or wanted_id in model.images else wanted_id
    image = pycolmap.Image(name=name, keypoints=keypoints, camera_id=camera_id, image_id=number)
    image.frame_id = 1 + max(model.frames)
    frame = pycolmap.Frame(frame_id=image.frame_id, rig_id=beside.frame.rig_id)
    frame.add_data_id(image.data_id)
    model.add_frame(frame)
    model.add_image(image)
    model.frame(image.frame_id).set_cam_from_world(camera_id, pycolmap.Rigid3d(pose))
    model.register_frame(image.frame_id)
    return model.images[number]


def refuse_other_model(folder: Path) -> None:
    """Raise an OutputError where a model lies that blur2view did not write, and so does not replace."""
    present = [name for name in (*FILES, PROJECT_FILE) if os.path.lexists(folder / name)]
    if present and not _project(folder).startswith(SIGN):
        raise OutputError(f"{folder / present[0]}: is not of an earlier call; name another folder with -o")


def write_model(model: Any, folder: Path, photographs: Path, database: Path | None = None) -> None:
    """Write a model and COLMAP's project.ini in place of an earlier one when all is there, or OutputError."""
    paths = {PICTURES: photographs} | ({} if database is None else {DATABASE: database})
    lines = [SIGN, *(f"{key}={path.absolute()}" for key, path in paths.items())]
    with tempfile.TemporaryDirectory(dir=writable_folder(folder)) as name:
        beside = Path(name)
        try:
            model.write(beside)
            (beside / "room").write_bytes(bytes(ROOM))  # pycolmap does not say that a disk is full
            (beside / PROJECT_FILE).write_bytes(os.fsencode("\n".join(lines) + "\n"))
            folder.mkdir(parents=True, exist_ok=True)
            for file in (PROJECT_FILE, *FILES):  # first what says whose they are, if it is killed here
                (beside / file).replace(folder / file)
        except (OSError, ValueError, RuntimeError) as error:
            why = getattr(error, "strerror", None) or " ".join(str(error).split())
            raise OutputError(
                f"{folder}: the model cannot be written there ({why}); make room or name another folder"
            ) from None


def noted(folder: Path, key: str) -> Path | None:
    """Return the path of a key of a model's project.ini, None without one or where nothing is."""
    lines = (line.partition("=") for line in _project(folder).splitlines())
    named = next((value.strip() for name, _, value in lines if name.strip() == key), "")
    return Path(named) if named and os.path.exists(named) else None


def _project(folder: Path) -> str:
    """Return the text of a model's project.ini, empty without one."""
    try:
        return os.fsdecode(read_regular(folder / PROJECT_FILE, MAX_PROJECT))
    except OSError:
        return ""
