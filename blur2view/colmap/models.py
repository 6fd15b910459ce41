"""COLMAP's models in folders: read by pycolmap, found, written whole, and the pictures that one is of."""

import hashlib
import mmap
import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from blur2view.arrays import Array
from blur2view.errors import DatabaseError, OutputError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.input_files import open_regular, read_regular
from blur2view.output_files import writable_folders

FILES = ("rigs.bin", "cameras.bin", "frames.bin", "images.bin", "points3D.bin")
PROJECT_FILE = "project.ini"  # as COLMAP writes beside a model
IMAGE_PATH, DATABASE_PATH = "image_path", "database_path"
SIGN = "# by blur2view, SHA-256 of the model: "  # of its files, in the order of FILES
BEYOND = 1e30  # of any number in a model
MAX_PROJECT = 1 << 20  # bytes
NO_MODEL = "name the folder with cameras.bin, images.bin and points3D.bin"


class FoundModel(NamedTuple):
    """The folder of a model, how many photographs it has, and how many others a mapper made beside it."""

    folder: Path
    registered: int
    others: int = 0


def read_model(folder: Path) -> Any:
    """Return the pycolmap.Reconstruction of a folder; DatabaseError of one that is not whole.

    Which points images see, which is much, is checked where it is looked up, by `seen_points`.
    """
    import pycolmap

    if not folder.is_dir():
        raise DatabaseError(f"{folder}: no such folder; {NO_MODEL}")
    if not holds_model(folder):
        raise DatabaseError(f"{folder}: holds no model of COLMAP's; {NO_MODEL}")
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


def seen_points(model: Any, image: Any, places: Iterable[int]) -> Array:
    """Return the 3D points (N, 3) that an image's points of these places are of.

    DatabaseError if the model does not have one of them, as a damaged one.
    """
    numbers = [image.points2D[place].point3D_id for place in places]
    if not all(number in model.points3D for number in numbers):
        raise DatabaseError(
            f"{image.name}: sees points that the model does not have; let COLMAP write it again"
        )
    return np.array([model.points3D[number].xyz for number in numbers]).reshape(-1, 3)


def _check_file(path: Path) -> None:
    """Raise OSError of what is no regular file, ValueError of one that ends within a record.

    pycolmap does not look where a file ends: of a points3D.bin that lacks its last byte it takes all memory.
    """
    with open_regular(path) as file:
        if path.name not in RECORDS:
            return
        before, number, part = RECORDS[path.name]
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            at = 8
            for _ in range(int.from_bytes(content[:8], "little")):
                at += before
                if path.name == "images.bin":
                    at = content.find(b"\0", at) + 1 or len(content)  # behind the name
                at += number + part * int.from_bytes(content[at : at + number], "little")
                if at > len(content):
                    raise ValueError(f"{path.name} ends within a record")


RECORDS = {"images.bin": (64, 8, 24), "points3D.bin": (43, 8, 8), "frames.bin": (64, 4, 16)}
"""Of a record: bytes before the number of its parts, but for a name; those of that number; of a part."""


def find_model(folder: Path) -> FoundModel:
    """Return the model in a folder, or the largest of those that a mapper has written below it, 0, 1, ...

    DatabaseError if none can be read.
    """
    below = sorted(path for path in folder.iterdir() if holds_model(path)) if folder.is_dir() else []
    folders = [folder] if holds_model(folder) or not below else below
    sizes = {path: len(photographs_of(read_model(path))) for path in folders}
    largest = max(sizes, key=lambda path: sizes[path])
    return FoundModel(folder=largest, registered=sizes[largest], others=len(sizes) - 1)


def holds_model(folder: Path) -> bool:
    """Return whether there are files of a model in a folder."""
    return any((folder / f"cameras.{suffix}").is_file() for suffix in ("bin", "txt"))


def photographs_of(model: Any) -> dict[str, Any]:
    """Return the registered images of a pycolmap.Reconstruction by name, views left out."""
    posed = {image.name: image for image in model.images.values() if image.has_pose}
    return {name: image for name, image in posed.items() if not name.endswith((OPEN, CLOSE))}


def add_image(
    model: Any, name: str, pose: Array, keypoints: Array, beside: Any, wanted_id: int | None = None
) -> Any:
    """Return a new image of a model at a pose (3, 4), alone in its frame, of the wanted id if that is free.

    With COLMAP's keypoints (N, 2), and the camera and rig of another image ``beside``.
    """
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


def refuse_other_model(folder: Path) -> bool:
    """Return whether a model of an earlier call will be replaced; OutputError of any other that is there.

    That of another program, and one that was refined since it was written.
    """
    present = [name for name in (*FILES, PROJECT_FILE) if os.path.lexists(folder / name)]
    if not present:
        return False
    first = _project(folder).partition("\n")[0]
    if not first.startswith(SIGN):
        raise OutputError(f"{folder / present[0]}: is not of an earlier call; name another folder with -o")
    if first != SIGN + _digest(folder):
        raise OutputError(
            f"{folder}: its model was changed since it was written; name another folder with -o"
        )
    return True


def write_model(model: Any, folder: Path, photographs: Path, database: Path | None = None) -> None:
    """Write a pycolmap.Reconstruction and COLMAP's project.ini, in place of an earlier one when all is there.

    pycolmap does not say that a disk is full: what it wrote is read back first. OutputError if that differs.
    """
    paths = {} if database is None else {DATABASE_PATH: database}
    paths[IMAGE_PATH] = photographs
    with writable_folders(folder), tempfile.TemporaryDirectory(dir=folder) as name:
        beside = Path(name)
        try:
            model.write(beside)
            again = read_model(beside)
            if again.summary() != model.summary() or dict(again.cameras) != dict(model.cameras):
                raise OSError("other counts than written")
            lines = [SIGN + _digest(beside), *(f"{key}={path.absolute()}" for key, path in paths.items())]
            (beside / PROJECT_FILE).write_bytes(os.fsencode("\n".join(lines) + "\n"))
            for file in (*FILES, PROJECT_FILE):
                (beside / file).replace(folder / file)
        except (OSError, ValueError, RuntimeError, DatabaseError) as error:
            why = getattr(error, "strerror", None) or "it cannot be read back whole"
            raise OutputError(
                f"{folder}: the model cannot be written there ({why}); make room or name another folder"
            ) from None


def _digest(folder: Path) -> str:
    """Return the SHA-256 of a model's files, of those that are there."""
    digest = hashlib.sha256()
    for name in FILES:
        try:
            with open_regular(folder / name) as file:
                while block := file.read(1 << 24):
                    digest.update(block)
        except OSError:
            digest.update(name.encode())
    return digest.hexdigest()


def pictures_of(folder: Path) -> Path | None:
    """Return the folder of photographs that a model's project.ini names, None without one."""
    return _noted(folder, IMAGE_PATH, os.path.isdir)


def database_of(folder: Path) -> Path | None:
    """Return the database that a model's project.ini names, None without one."""
    return _noted(folder, DATABASE_PATH, os.path.isfile)


def _noted(folder: Path, key: str, exists: Callable[[str], bool]) -> Path | None:
    """Return the path of a key of a model's project.ini, None where there is nothing."""
    lines = (line.partition("=") for line in _project(folder).splitlines())
    named = next((value.strip() for name, _, value in lines if name.strip() == key), "")
    return Path(named) if named and exists(named) else None


def _project(folder: Path) -> str:
    """Return the text of a model's project.ini, empty without one."""
    try:
        return os.fsdecode(read_regular(folder / PROJECT_FILE, MAX_PROJECT))
    except OSError:
        return ""
