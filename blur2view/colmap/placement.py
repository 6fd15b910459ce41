"""Virtual views put into a reconstruction of their photographs, with the motion that the trajectory explains.

A mapper places each view by itself, from smears that err together: on a rendered video 22 of 28 views, the
rotation during the exposure off by 88 %. Here the photographs' poses, which blur hardly harms, are the
trajectory, and smears measure what fraction of it an exposure is (`trajectory`).
"""

import os
import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.arrays import Array
from blur2view.camera.colmap_camera import from_colmap, normalised_points
from blur2view.colmap.connection import open_read_only
from blur2view.colmap.models import read_model, seen_points
from blur2view.colmap.project import frame_of, image_names, read_keypoints, read_matches
from blur2view.errors import DatabaseError
from blur2view.exposure.time_direction import frame_times, place_of
from blur2view.exposure.trajectory import ExposedFrame, Trajectory, exposures
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.geometry.rotation import rotation_matrix

UNREGISTERED = "COLMAP did not register them"
PLACED_BEFORE = "the model has their views already"
NOT_NAMED = "they are not in the folder of the frames"
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
    views: tuple[Any, Any]  # pycolmap.Image at open and close, of no model
    seen: list[int]  # indices of features that have both ends and a 3D point


def place_views(
    database: str | os.PathLike[str],
    model: str | os.PathLike[str],
    names: Sequence[str] | None = None,
    fraction: float | None = None,
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
    registered = {image.name: image for image in reconstruction.images.values() if image.has_pose}
    if names is None:
        names = sorted((name for name in registered if not name.endswith((OPEN, CLOSE))), key=place_of)
    times = dict(zip(names, frame_times(names), strict=True))
    linked, refused = _read_linked(Path(database), registered, names)
    if not linked:
        raise DatabaseError(f"{database}: {_nothing_to_place(Path(model), registered, names, refused)}")
    trajectory = Trajectory(
        times=np.array([times[one.photograph.name] for one in linked], float),
        poses=np.stack([one.photograph.cam_from_world().matrix() for one in linked]),
    )
    frames = [_frame(reconstruction, one) for one in linked]
    ends, used, measured = exposures(frames, trajectory, fraction)
    known = np.isfinite(ends[:, 0, 0])
    for index in np.flatnonzero(known):
        _add_views(reconstruction, linked[index], ends[index])
    at = dict(zip((one.photograph.name for one in linked), known, strict=True))
    return Placement(
        model=reconstruction,
        fraction=used,
        measured=measured,
        placed=tuple(name for name, is_known in at.items() if is_known),
        refused=refused | {name: ALONE for name, is_known in at.items() if not is_known},
    )


def _nothing_to_place(
    model: Path, registered: Mapping[str, Any], names: Sequence[str], refused: Mapping[str, str]
) -> str:
    """Return why no photograph with views can be placed, and the remedy."""
    photographs = [name for name in registered if not name.endswith((OPEN, CLOSE))]
    if names and photographs and not set(names) & set(photographs):
        called = f"the frames are called {names[0]} ..., those of {model} {photographs[0]} ..."
        return f"{called}; name the folder that COLMAP read them from"
    if not refused:
        return f"has no views of the frames in {model}; link them first (blur2view to-colmap --link)"
    return f"has views of {len(refused)} frames, of which none can be placed: {next(iter(refused.values()))}"


def _read_linked(
    database: Path, registered: Mapping[str, Any], names: Sequence[str]
) -> tuple[list[_Linked], dict[str, str]]:
    """Return the photographs that can be placed, and why the others with both views cannot."""
    with open_read_only(database) as opened:
        ids = image_names(opened)
        linked = {name for name in ids if {name + OPEN, name + CLOSE} <= ids.keys()}
        for name in linked & registered.keys():
            if ids[name] != registered[name].image_id:
                why = "has another id in the model; name the database that is the model's"
                raise DatabaseError(f"{database}: {name} {why}")
        refused = {name: UNREGISTERED for name in ids if name in linked and name not in registered}
        refused |= {name: PLACED_BEFORE for name in linked if name + OPEN in registered}
        refused = {name: NOT_NAMED for name in linked.difference(names)} | refused
        found = [name for name in names if name in linked and name not in refused]
        return [_read_one(opened, ids, registered[name]) for name in found], refused


def _read_one(opened: sqlite3.Connection, ids: Mapping[str, int], photograph: Any) -> _Linked:
    """Return a photograph with its views, of which the database has both; ValueError if a row is damaged."""
    import pycolmap

    views = []
    for name in (photograph.name + OPEN, photograph.name + CLOSE):
        points, camera_id = read_keypoints(opened, ids[name]), photograph.camera_id
        view = pycolmap.Image(name=name, keypoints=points, camera_id=camera_id, image_id=ids[name])
        own = frame_of(opened, ids[name])
        view.frame_id = ids[name] if own is None else own  # as mappers number them
        views.append(view)
    first, last = views
    matched = read_matches(opened, "matches", photograph.image_id, first.image_id)[:, 0]
    count, points = min(image.num_points2D() for image in (photograph, first, last)), photograph.points2D
    seen = [index for index in map(int, matched) if index < count and points[index].has_point3D()]
    return _Linked(photograph=photograph, views=(first, last), seen=seen)


def _frame(model: Any, one: _Linked) -> ExposedFrame:
    """Return the smears of the features whose 3D point lies in front of the camera."""
    camera, pose = model.cameras[one.photograph.camera_id], one.photograph.cam_from_world().matrix()
    world = seen_points(model, one.photograph, one.seen)
    depth = world @ pose[2, :3] + pose[2, 3]
    pixels = np.array([[view.points2D[i].xy for i in one.seen] for view in one.views]).reshape(2, -1, 2)
    first, last = (normalised_points(camera, from_colmap(ends)) for ends in pixels)
    good = (depth > 0) & np.isfinite(first).all(axis=1) & np.isfinite(last).all(axis=1)
    return ExposedFrame(
        rays=0.5 * (first + last)[good], displacement=(last - first)[good], inverse_depth=1 / depth[good]
    )


def _add_views(model: Any, one: _Linked, ends: Array) -> None:
    """Add both images where the camera is (2, 6), in that of the photograph, and what they observe.

    Each is alone in its frame; the rig, which may have more cameras, is that of the photograph. A view
    observes the photograph's 3D points that project within `MAX_ERROR_PX`.
    """
    import pycolmap

    photograph = one.photograph
    for view, end in zip(one.views, ends, strict=True):
        if model.exists_frame(view.frame_id):  # the model is older than the project's frames
            view.frame_id = 1 + max(model.frames)
        frame = pycolmap.Frame(frame_id=view.frame_id, rig_id=photograph.frame.rig_id)
        frame.add_data_id(view.data_id)
        model.add_frame(frame)
        model.add_image(view)
        R = rotation_matrix(end[:3])
        pose = pycolmap.Rigid3d(np.column_stack([R, -R @ end[3:]])) * photograph.cam_from_world()
        model.frame(view.frame_id).set_cam_from_world(photograph.camera_id, pose)
        model.register_frame(view.frame_id)
        image = model.images[view.image_id]
        for index in one.seen:
            number = photograph.points2D[index].point3D_id
            projected = image.project_point(model.points3D[number].xyz)
            missed = None if projected is None else np.linalg.norm(projected - image.points2D[index].xy)
            if missed is not None and missed < MAX_ERROR_PX:
                model.add_observation(number, pycolmap.TrackElement(view.image_id, index))
