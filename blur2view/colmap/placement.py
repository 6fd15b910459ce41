"""Virtual views put into a reconstruction of their photographs, with the motion that the trajectory explains.

A mapper places each view by itself, from smears that err together: on a rendered video 22 of 28 views, the
rotation during the exposure off by 88 %. Here the photographs' poses, which blur hardly harms, are the
trajectory, and smears measure what fraction of it an exposure is (`trajectory`).
"""

import os
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.arrays import Array
from blur2view.camera.camera import from_colmap, normalised_points
from blur2view.colmap.models import add_image, photographs_of, read_model, seen_points
from blur2view.colmap.project import image_names, open_read_only, read_keypoints, read_matches
from blur2view.errors import DatabaseError
from blur2view.exposure.camera_path import CameraPath, changed
from blur2view.exposure.time_direction import frame_times, place_of
from blur2view.exposure.trajectory import PATH_REACH, ExposedFrame, exposures
from blur2view.exposure.views import CLOSE, OPEN

UNREGISTERED = "COLMAP did not register them"
PLACED_BEFORE = "the model has their views already"
RECOVERED = "they were recovered, with their views"
NOT_NAMED = "they are not in the folder of the frames"
OTHER_FEATURES = "their features in the model are not those of the database"
ALONE = "no frame of the model is next to them by number"
MAX_ERROR_PX = 4.0  # of a point in a view, as COLMAP's filter_max_reproj_error


@dataclass(frozen=True, kw_only=True)
class Placement:
    """A reconstruction with virtual views.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        As it was, with both views of ``placed`` beside their photographs, and with observations of its
        points in them where these lie within `MAX_ERROR_PX`.
    fraction : float
        Exposure over frame interval: the given one, or as measured from the smears, with the same relative
        bias as their length; NaN if unknown.
    measured : bool
        False where it is a guess, as the camera shakes faster than frames follow one another and the smears
        are longer than of a whole interval.
    placed : tuple of str
        Photographs whose views were placed.
    refused : dict of str to str
        Why, of every other photograph with views in the database, by its name.
    """

    model: Any
    fraction: float
    measured: bool
    placed: tuple[str, ...]
    refused: dict[str, str]

    @property
    def linked(self) -> int:
        """How many photographs have views in the database."""
        return len(self.placed) + len(self.refused)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Linked:
    """A registered photograph and its views, as the database has them."""

    photograph: Any  # pycolmap.Image of the model
    ids: tuple[int, int]  # of the views at open and close
    ends: Array  # (2, N, 2): COLMAP's keypoints of both views
    seen: list[int]  # indices of features that have both ends and a 3D point


def place_views(
    database: str | os.PathLike[str],
    model: str | os.PathLike[str],
    names: Sequence[str] | None = None,
    fraction: float | None = None,
    show: Callable[[int, int], None] = lambda done, count: None,
) -> Placement:
    """Return a model with the virtual views of a linked project placed beside its photographs.

    Parameters
    ----------
    database : path-like
        That ``blur2view to-colmap --link`` has written views to.
    model : path-like
        Folder of a reconstruction of its photographs, views left out (``image_names``, or made before).
    names : sequence of str, optional
        Photographs of one video in order, parted where their numbers say that some were left out
        (`frame_times`); those that are not registered or have no views are passed over. Default: those of
        the model by the last number of their names.
    fraction : float, optional
        Exposure time over frame interval, if it is known; default: measured from the smears.
    show : callable
        Called with how many frames are read, and of how many.

    Returns
    -------
    Placement

    Raises
    ------
    DatabaseError
        If the database or the model is missing or broken, or holds no views of the model's photographs.
    ValueError
        If the fraction is not positive and finite.
    """
    if fraction is not None and not 0 < fraction < np.inf:
        raise ValueError(f"fraction must be positive and finite, got {fraction}")
    reconstruction = read_model(Path(model))
    registered = photographs_of(reconstruction)
    if names is None:
        names = sorted(registered, key=place_of)
    times = dict(zip(names, frame_times(names), strict=True))
    linked, refused = _read_linked(Path(database), reconstruction, registered, names, show)
    if not linked:
        raise DatabaseError(f"{database}: {_nothing_to_place(Path(model), registered, names, refused)}")
    known = [name for name in names if name in registered]
    poses = np.stack([registered[name].cam_from_world().matrix() for name in known])
    path = CameraPath(np.array([times[name] for name in known]), poses, PATH_REACH)
    frames = [_frame(reconstruction, one, times[one.photograph.name]) for one in linked]
    ends, used, measured = exposures(frames, path, fraction)
    placed = np.isfinite(ends[:, 0, 0])
    for index in np.flatnonzero(placed):
        _add_views(reconstruction, linked[index], ends[index])
    found = {one.photograph.name: bool(is_placed) for one, is_placed in zip(linked, placed, strict=True)}
    return Placement(
        model=reconstruction,
        fraction=used,
        measured=measured,
        placed=tuple(name for name, is_placed in found.items() if is_placed),
        refused=refused | {name: ALONE for name, is_placed in found.items() if not is_placed},
    )


def _nothing_to_place(
    model: Path, registered: Mapping[str, Any], names: Sequence[str], refused: Mapping[str, str]
) -> str:
    """Return why no photograph with views can be placed, and the remedy."""
    if names and registered and not set(names) & registered.keys():
        called = f"the frames are called {names[0]} ..., those of {model} {next(iter(registered))} ..."
        return f"{called}; name the folder that COLMAP read them from"
    if not refused:
        return f"has no views of the frames in {model}; link them first (blur2view to-colmap --link)"
    return f"has views of {len(refused)} frames, of which none can be placed: {next(iter(refused.values()))}"


def _read_linked(
    database: Path,
    model: Any,
    registered: Mapping[str, Any],
    names: Sequence[str],
    show: Callable[[int, int], None],
) -> tuple[list[_Linked], dict[str, str]]:
    """Return the photographs that can be placed, and why the others with both views cannot."""
    found, refused, order = dict[str, _Linked](), dict[str, str](), set(names)
    with open_read_only(database) as opened:
        ids, states = image_names(opened), linked_states(opened, model)
        for number, (name, why) in enumerate(states.items()):
            show(number, len(states))
            if why or name not in order:
                refused[name] = why or NOT_NAMED
            else:
                found[name] = _read_one(opened, ids, registered[name])
    return [found[name] for name in names if name in found], refused


def linked_states(opened: sqlite3.Connection, model: Any) -> dict[str, str]:
    """Return of each photograph with both views in a database why they are not to be put into a model.

    "" if they are; `PLACED_BEFORE` and `RECOVERED` are there.
    """
    photographs, ids = photographs_of(model), image_names(opened)
    there = {image.name for image in model.images.values() if image.has_pose}
    found = {}
    for name in (name for name in ids if {name + OPEN, name + CLOSE} <= ids.keys()):
        has_views = name + OPEN in there
        if name not in photographs:
            found[name] = UNREGISTERED
        elif photographs[name].num_points2D() == len(read_keypoints(opened, ids[name])):
            found[name] = PLACED_BEFORE if has_views else ""
        else:
            found[name] = RECOVERED if has_views else OTHER_FEATURES
    return found


def _read_one(opened: sqlite3.Connection, ids: Mapping[str, int], photograph: Any) -> _Linked:
    """Return a photograph with its views, of which the database has both; ValueError if a row is damaged."""
    first, last = (ids[photograph.name + end] for end in (OPEN, CLOSE))
    ends = [read_keypoints(opened, number) for number in (first, last)]
    count, points = min(photograph.num_points2D(), *map(len, ends)), photograph.points2D
    matched = read_matches(opened, "matches", ids[photograph.name], first)[:, 0]
    seen = [index for index in map(int, matched) if index < count and points[index].has_point3D()]
    return _Linked(
        photograph=photograph, ids=(first, last), ends=np.stack([one[:count] for one in ends]), seen=seen
    )


def _frame(model: Any, one: _Linked, time: float) -> ExposedFrame:
    """Return the smears of the features whose 3D point lies in front of the camera."""
    camera, pose = model.cameras[one.photograph.camera_id], one.photograph.cam_from_world().matrix()
    world = seen_points(model, one.photograph, one.seen)
    depth = world @ pose[2, :3] + pose[2, 3]
    first, last = (normalised_points(camera, from_colmap(ends[one.seen])) for ends in one.ends)
    good = (depth > 0) & np.isfinite(first).all(axis=1) & np.isfinite(last).all(axis=1)
    return ExposedFrame(
        time=time,
        rays=0.5 * (first + last)[good],
        displacement=(last - first)[good],
        inverse_depth=1 / depth[good],
    )


def _add_views(model: Any, one: _Linked, changes: Array) -> None:
    """Add both images, by the changes (2, 6) from the photograph's pose to theirs, and what they observe.

    A view observes the photograph's 3D points that project within `MAX_ERROR_PX`.
    """
    import pycolmap

    photograph = one.photograph
    pose = photograph.cam_from_world().matrix()
    for end, number, points, change in zip((OPEN, CLOSE), one.ids, one.ends, changes, strict=True):
        image = add_image(model, photograph.name + end, changed(pose, change), points, photograph, number)
        for index in one.seen:
            point = photograph.points2D[index].point3D_id
            projected = image.project_point(model.points3D[point].xyz)
            missed = None if projected is None else np.linalg.norm(projected - points[index])
            if missed is not None and missed < MAX_ERROR_PX:
                model.add_observation(point, pycolmap.TrackElement(image.image_id, index))
