"""Virtual views put into a reconstruction of their photographs, with the motion that the trajectory explains.

A mapper places each view by itself, from smears that err together: on a rendered video 22 of 28 views, the
rotation during the exposure off by 88 %. Here the photographs' poses, which blur hardly harms, are the
trajectory, and smears measure what fraction of it an exposure is (`trajectory`).
"""

import os
import sqlite3
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from blur2view.arrays import Array
from blur2view.camera import from_colmap, normalised_points
from blur2view.colmap.models import DatabaseIds, add_image, observed, read_ids, read_model, registered_images
from blur2view.colmap.project import image_names, open_read_only, read_keypoints, read_matches
from blur2view.errors import DatabaseError
from blur2view.exposure.sequence import frame_times, split_number
from blur2view.exposure.trajectory import PATH_REACH, CameraPath, ExposedFrame, changed, exposures
from blur2view.exposure.views import CLOSE, OPEN

MAX_REPROJECTION_PX = 4.0  # of a point in a view: COLMAP's filter_max_reproj_error
MAX_TANGENT = 30.0  # of a ray's angle to the axis (bound): beyond, a row or a focal length is damaged
MIN_SMEAR = 1e-6  # in the same coordinates (bound): a hundredth of a pixel of the longest lens
UNREGISTERED = "COLMAP did not register them (blur2view recover may), or they have other names there"
NO_NEIGHBOUR = "the model has no frame with the next number"
NO_EXPOSURE = "the smears of no frame show how long an exposure is"


class Placement(NamedTuple):
    """A reconstruction with virtual views."""

    model: Any
    """pycolmap.Reconstruction with both views of ``placed``; they observe points within 4 px."""
    fraction: float  # exposure over frame interval: given, or as measured from the smears; NaN if unknown
    measured: bool  # False where it is a guess, as the camera shakes faster than frames follow one another
    placed: tuple[str, ...]  # photographs whose views were placed
    refused: dict[str, str]  # the reason, by the name of every other photograph with views in the database


class _Linked(NamedTuple):
    """A registered photograph and its views, as the database has them."""

    photograph: Any  # pycolmap.Image of the model
    ends: Array  # (2, N, 2): COLMAP's keypoints of both views
    seen: dict[int, int]  # ids of 3D points by the features that observe them and have both ends


def place_views(
    database: str | os.PathLike[str],
    model: str | os.PathLike[str],
    names: Sequence[str] | None = None,
    fraction: float | None = None,
) -> Placement:
    """Return COLMAP's model of a video with the views that ``to-colmap --link`` wrote beside its frames.

    Nothing is written: `Placement.model` is pycolmap's. The frames stay where they are.

    Parameters
    ----------
    database : path
        The project with the views.
    model : path
        Folder of COLMAP's model of the frames.
    names : sequence of str, optional
        The frames of one video in order, as COLMAP calls them; by default those of the model. The numbers in
        names that differ in nothing else are times (`frame_times`).
    fraction : float, optional
        Exposure time over frame interval, the median step of these times; by default measured from the
        smears.

    Returns
    -------
    Placement
        The model with the views NAME#open and NAME#close, and what became of every frame.

    Raises
    ------
    DatabaseError
        If database or model cannot be read, or no view can be placed.
    ValueError
        If the fraction is not positive.

    Examples
    --------
    A project of which ``blur2view to-colmap --db project.db --link --sequence frames`` has linked the
    frames, and COLMAP's model of these::

        placement = blur2view.place_views("project.db", "model")
        placement.model.write("with_views")  # as `blur2view place` does
    """
    if fraction is not None and not 0 < fraction < np.inf:
        raise ValueError(f"fraction must be positive and finite, got {fraction}")
    reconstruction = read_model(Path(model))
    registered = registered_images(reconstruction)
    names = sorted(registered, key=split_number) if names is None else names
    times = dict(zip(names, frame_times(names), strict=True))
    linked, refused = _read_linked(Path(database), reconstruction, registered, times)
    if not linked:
        why = "; ".join(dict.fromkeys(refused.values())) or "link them first (blur2view to-colmap --link)"
        raise DatabaseError(f"{database}: has no views of frames in {model} that can be placed: {why}")
    known = {times[name]: registered[name].cam_from_world().matrix() for name in names if name in registered}
    path = CameraPath(np.array([*known]), np.stack([*known.values()]), PATH_REACH)
    frames = [_exposed(reconstruction, link, times[link.photograph.name]) for link in linked]
    try:
        ends, used, measured = exposures(frames, path, fraction)
    except np.linalg.LinAlgError:
        remedy = "link them again (blur2view to-colmap --link)"
        raise DatabaseError(f"{database}: no motion explains the smears of its views; {remedy}") from None
    placed, numbers = [], read_ids(Path(database))
    for link, changes in zip(linked, ends, strict=True):
        if np.isfinite(changes).all():
            _add_views(reconstruction, link, changes, numbers)
            placed.append(link.photograph.name)
        else:
            refused[link.photograph.name] = NO_NEIGHBOUR if used > 0 else NO_EXPOSURE
    return Placement(reconstruction, used, measured, tuple(placed), refused)


def _read_linked(
    database: Path, model: Any, registered: Mapping[str, Any], times: Mapping[str, float]
) -> tuple[list[_Linked], dict[str, str]]:
    """Return the photographs that can be placed, in order, and why others with both views cannot."""
    found, refused = dict[str, _Linked](), dict[str, str]()
    views = {image.name for image in model.images.values() if image.has_pose}
    with open_read_only(database) as opened:
        ids = image_names(opened)
        for name in (name for name in ids if {name + OPEN, name + CLOSE} <= ids.keys()):
            if name not in registered:
                refused[name] = UNREGISTERED
            elif name + OPEN in views:  # of an earlier call, or recovered
                refused[name] = "the model has their views already"
            elif name not in times:
                refused[name] = "they are not in the folder of the frames"
            elif registered[name].num_points2D() != len(read_keypoints(opened, ids[name])):
                refused[name] = "their features in the model are not those of the database"
            else:
                found[name] = _read_one(opened, ids, model, registered[name])
    return [found[name] for name in times if name in found], refused


def _read_one(opened: sqlite3.Connection, ids: Mapping[str, int], model: Any, photograph: Any) -> _Linked:
    """Return a photograph with its views; ValueError if a row is damaged."""
    first, last = (ids[photograph.name + end] for end in (OPEN, CLOSE))
    ends = [read_keypoints(opened, number) for number in (first, last)]
    count, points = min(map(len, ends)), observed(model, photograph)
    matched = map(int, read_matches(opened, ids[photograph.name], first)[:, 0])
    seen = {index: points[index] for index in matched if index < count and index in points}
    return _Linked(photograph, np.stack([keypoints[:count] for keypoints in ends]), seen)


def _exposed(model: Any, link: _Linked, time: float) -> ExposedFrame:
    """Return the smears of features whose 3D points lie in front of the camera; damaged ones are left out."""
    camera, pose = model.cameras[link.photograph.camera_id], link.photograph.cam_from_world().matrix()
    world = np.array([model.points3D[number].xyz for number in link.seen.values()]).reshape(-1, 3)
    depth = world @ pose[2, :3] + pose[2, 3]
    first, last = (normalised_points(camera, from_colmap(ends[[*link.seen]])) for ends in link.ends)
    within = np.all(np.abs(np.hstack([first, last])) < MAX_TANGENT, axis=1)  # False of NaN
    first, last = (np.where(within[:, None], end, 0.0) for end in (first, last))
    good = within & (depth > 0) & (np.linalg.norm(last - first, axis=1) > MIN_SMEAR)
    rays, displacement = 0.5 * (first + last)[good], (last - first)[good]
    return ExposedFrame(time=time, rays=rays, displacement=displacement, inverse_depth=1 / depth[good])


def _add_views(model: Any, link: _Linked, changes: Array, ids: DatabaseIds) -> None:
    """Add both images, by the changes (2, 6) from the photograph's pose, and observations of its points."""
    import pycolmap

    pose = link.photograph.cam_from_world().matrix()
    for end, points, change in zip((OPEN, CLOSE), link.ends, changes, strict=True):
        name = link.photograph.name + end
        image = add_image(model, name, changed(pose, change), points, link.photograph, ids)
        for index, point in link.seen.items():
            pixel = image.project_point(model.points3D[point].xyz)
            if pixel is not None and np.linalg.norm(pixel - points[index]) < MAX_REPROJECTION_PX:
                model.add_observation(point, pycolmap.TrackElement(image.image_id, index))
