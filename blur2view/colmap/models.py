"""COLMAP's models in folders: the largest of a mapper's, and the pictures that one is of."""

import mmap
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from blur2view.arrays import Array
from blur2view.errors import DatabaseError
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.input_files import open_regular, read_regular

PROJECT_FILE = "project.ini"  # as COLMAP writes beside a model
IMAGE_PATH, DATABASE_PATH = "image_path", "database_path"
SIGN = "# by blur2view place\n"  # or to-transforms
BEYOND = 1e30  # of any number in a model
MAX_PROJECT = 1 << 20  # bytes


class FoundModel(NamedTuple):
    """The folder of a model, how many photographs it has, and how many others a mapper made beside it."""

    folder: Path
    registered: int
    others: int = 0


def read_model(folder: Path) -> Any:
    """Return the pycolmap.Reconstruction of a folder; DatabaseError if there is none that is whole.

    Which points images see, which is much, is checked where it is looked up, by `seen_points`.
    """
    import pycolmap

    try:
        for path in folder.iterdir():
            if path.suffix in (".bin", ".txt"):
                _check_file(path)
        model = pycolmap.Reconstruction(folder)
        _check_model(folder, model)
        return model
    except (OSError, ValueError, RuntimeError, LookupError):  # of files that do not go together
        reason = "holds no model that can be read" if folder.is_dir() else "no such folder"
        remedy = "name the one with cameras.bin, images.bin and points3D.bin"
        raise DatabaseError(f"{folder}: {reason}; {remedy}") from None


def _check_model(folder: Path, model: Any) -> None:
    """Raise a DatabaseError where a model contradicts itself; pycolmap's own errors of what it holds pass."""
    faults = [
        f"camera {camera.camera_id} has parameters that none has"
        for camera in model.cameras.values()
        if not _possible(camera.params)
    ]
    if not _possible([point.xyz for point in model.points3D.values()]):
        faults.append("has points that are nowhere")
    for number, image in model.images.items():
        try:
            if image.name and image.has_pose and not _possible(image.cam_from_world().matrix()):
                faults.append(f"image {image.name} has a pose that is nowhere")
        except UnicodeDecodeError:
            faults.append(f"the name of image {number} is no UTF-8")
    if faults:
        raise DatabaseError(f"{folder}: {faults[0]}; let COLMAP write the model again")


def _possible(values: Any) -> bool:
    """Return whether numbers are finite, and what is computed from them."""
    return bool((np.abs(np.asarray(values, float)) < BEYOND).all())  # False of NaN


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
    """Raise OSError of what is no regular file, ValueError of a count that pycolmap would take memory for."""
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
                    raise ValueError(f"{path}: ends within a record")


RECORDS = {"images.bin": (64, 8, 24), "points3D.bin": (43, 8, 8), "frames.bin": (64, 4, 16)}
"""Of a record: bytes before the number of its parts, but for a name; those of that number; of a part.

What cameras.bin and rigs.bin announce pycolmap checks itself."""


def find_model(folder: Path) -> FoundModel:
    """Return the model in a folder, or the largest of those that a mapper has written below it, 0, 1, ...

    DatabaseError if there is none that can be read.
    """
    below = sorted(path for path in folder.iterdir() if holds_model(path)) if folder.is_dir() else []
    folders = [folder] if holds_model(folder) or not below else below
    sizes = {path: _photographs(read_model(path)) for path in folders}
    largest = max(sizes, key=lambda path: sizes[path])
    return FoundModel(folder=largest, registered=sizes[largest], others=len(sizes) - 1)


def holds_model(folder: Path) -> bool:
    """Return whether there are files of a model in a folder."""
    return any((folder / f"cameras.{suffix}").is_file() for suffix in ("bin", "txt"))


def is_ours(folder: Path) -> bool:
    """Return whether the model in a folder is one that `project_text` stands beside."""
    return _project(folder).startswith(SIGN)


def _photographs(model: Any) -> int:
    """Return how many photographs are registered, views not counted."""
    posed = (image.name for image in model.images.values() if image.has_pose)
    return sum(not name.endswith((OPEN, CLOSE)) for name in posed)


def project_text(photographs: Path, database: Path | None = None) -> str:
    """Return COLMAP's project.ini of a model of ours."""
    paths = {} if database is None else {DATABASE_PATH: database}
    paths[IMAGE_PATH] = photographs
    return SIGN + "".join(f"{key}={os.path.abspath(path)}\n" for key, path in paths.items())


def pictures_of(folder: Path) -> Path | None:
    """Return the folder of the photographs that a model's project.ini names, None if there is none."""
    settings = dict(line.split("=", 1) for line in _project(folder).splitlines() if "=" in line)
    named = settings.get(IMAGE_PATH, "").strip()
    return Path(named) if named and os.path.isdir(named) else None


def _project(folder: Path) -> str:
    """Return the text of a model's project.ini, empty without one."""
    try:
        return os.fsdecode(read_regular(folder / PROJECT_FILE, MAX_PROJECT))
    except OSError:
        return ""
