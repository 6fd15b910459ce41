"""Keypoints and matches for videos of which every frame is blurred, from a first model that COLMAP made.

Where all frames are blurred SIFT finds few features again, each of them a pixel or more off, and so are the
poses. Corners of each frame, and what was found in it from earlier ones, are looked for in the next frames:
where the first model expects them, by patches blurred alike (`blurred_pose`). They become keypoints and
verified matches of a copy of the project's database, from which COLMAP maps anew.
"""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera import normalised_points, to_colmap
from blur2view.colmap.blurred_pose import View, find_pose, inverse_depth_at
from blur2view.colmap.project import image_names, open_read_only
from blur2view.colmap.recovery import FrameSequence
from blur2view.errors import DatabaseError
from blur2view.output_files import half_written

BEFORE = 3  # frames, the last, whose keypoints are looked for in a frame
CORNERS, QUALITY, SIGMA_PX = 800, 0.005, 2.0  # corners of a frame, as OpenCV finds them after smoothing
APART_PX = 6.0  # from a corner to the next keypoint
SAME_PX = 1.0  # between places of one keypoint
LEAST_MATCHES = 15  # of a pair
VERIFY_PX = 3.0  # of two-view geometries
Keypoints = dict[str, Array]  # (N, 2) of each frame, pixels of the working size


def track_frames(
    sequence: FrameSequence,
    database: Path,
    target: Path,
    show: Callable[[int, int], None] = lambda done, count: None,
) -> None:
    """Write a copy of a database with keypoints of known frames, matched with those of `BEFORE` before."""
    names = sorted(sequence.poses, key=lambda name: sequence.times[name])
    beside = half_written(target)
    beside.unlink(missing_ok=True)  # of a call that was killed
    try:
        with open_read_only(database) as source, closing(sqlite3.connect(beside)) as copy:
            ids = image_names(source)
            if missing := [name for name in names if name not in ids]:
                raise DatabaseError(f"{database}: has no image {missing[0]}; name the database of the model")
            source.backup(copy)  # pycolmap writes to what it opens
        keypoints: Keypoints = {name: np.zeros((0, 2)) for name in names}
        matches: dict[tuple[str, str], NDArray[np.uint32]] = {}
        for index, name in enumerate(names):
            show(index, len(names))
            view = sequence.view(name, sequence.poses[name])
            for one in names[max(0, index - BEFORE) : index]:
                both = _matches(sequence, view, name, one, keypoints)
                if len(both) >= LEAST_MATCHES:
                    matches[one, name] = both
            _numbers(keypoints, name, _corners(view.image), APART_PX)
        _write_tracks(beside, sequence, ids, keypoints, matches)
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)


def _numbers(keypoints: Keypoints, name: str, places: Array, apart_px: float) -> list[int]:
    """Return the numbers of a frame's keypoints at places (N, 2), new ones where none is so near."""
    found = []
    for place in places:
        away = np.linalg.norm(keypoints[name] - place, axis=1)
        if not len(away) or away.min() > apart_px:
            keypoints[name], away = np.vstack([keypoints[name], place]), np.append(away, 0.0)
        found.append(int(away.argmin()))
    return found


def _corners(image: Any) -> Array:
    """Return corners (N, 2) of a picture, float32."""
    smooth = cv2.GaussianBlur(np.sqrt(np.maximum(image, 0)), (0, 0), SIGMA_PX)
    corners = cv2.goodFeaturesToTrack(smooth, CORNERS, QUALITY, APART_PX)
    return np.zeros((0, 2)) if corners is None else corners[:, 0].astype(float)


def _matches(
    sequence: FrameSequence, view: View, name: str, before: str, keypoints: Keypoints
) -> NDArray[np.uint32]:
    """Return index pairs (M, 2) of keypoints of an earlier frame and of this one, where they are found."""
    other, expected = sequence.view(before, sequence.poses[before]), sequence.expected(name)
    world = _surfaces(other, keypoints[before], sequence.world(sequence.points_of(before)))
    everything = [np.ones(len(world), bool)]
    found = None if expected is None else find_pose(view, [other], world, everything, expected.motion)
    if found is None:
        return np.zeros((0, 2), np.uint32)
    numbers = _numbers(keypoints, name, found.places, SAME_PX)
    _, first = np.unique(numbers, return_index=True)
    return np.column_stack([found.numbers, numbers]).astype(np.uint32)[np.sort(first)]


def _surfaces(view: View, pixels: Array, world: Array) -> Array:
    """Return the points (N, 3) of the world at pixels (N, 2), as deep as points that the view sees nearby."""
    depth = 1 / inverse_depth_at(pixels, view.project(world), view.points(world)[:, 2])
    rays = np.column_stack([normalised_points(view.camera, pixels), np.ones(len(pixels))])
    return np.asarray((rays * depth[:, None] - view.pose[:, 3]) @ view.pose[:, :3])


def _write_tracks(
    path: Path,
    sequence: FrameSequence,
    ids: dict[str, int],
    keypoints: Keypoints,
    matches: dict[tuple[str, str], NDArray[np.uint32]],
) -> None:
    """Write keypoints of frames and matches of pairs of them into a database that holds these images."""
    import pycolmap

    with pycolmap.Database.open(path) as opened:
        first = {}
        for name, places in keypoints.items():
            camera = sequence.view(name, sequence.poses[name]).camera
            scale = opened.read_camera(opened.read_image(ids[name]).camera_id).width / camera.width
            first[name] = _write_keypoints(opened, ids[name], to_colmap((places + 0.5) * scale - 0.5))
        for (one, other), both in matches.items():
            numbers = (both + (first[one], first[other])).astype(np.uint32)
            _write_pair(opened, ids[one], ids[other], numbers)


def _write_keypoints(opened: Any, image_id: int, places: Array) -> int:
    """Write keypoints (N, 2) of scale one behind those of an image, and return the number of the first."""
    own = opened.read_keypoints(image_id)
    width = own.shape[1] if len(own) else 4
    more = np.zeros((len(places), width), np.float32)
    more[:, :2] = places
    more[:, [2, 5] if width == 6 else [2]] = 1
    opened.update_keypoints(image_id, np.vstack([own, more]))
    return len(own)


def _write_pair(opened: Any, one: int, other: int, numbers: NDArray[np.uint32]) -> None:
    """Write the matches (M, 2) of a pair of images and their two-view geometry in place of its own."""
    import pycolmap

    options = pycolmap.TwoViewGeometryOptions()
    options.compute_relative_pose, options.ransac.max_error, options.ransac.random_seed = True, VERIFY_PX, 0
    cameras = [opened.read_camera(opened.read_image(number).camera_id) for number in (one, other)]
    points = [opened.read_keypoints(number)[:, :2].astype(float) for number in (one, other)]
    geometry = pycolmap.estimate_calibrated_two_view_geometry(
        cameras[0], points[0], cameras[1], points[1], numbers, options
    )
    if opened.exists_matches(one, other):
        opened.delete_matches(one, other)
    if opened.exists_two_view_geometry(one, other):
        opened.delete_two_view_geometry(one, other)
    opened.write_matches(one, other, numbers)
    opened.write_two_view_geometry(one, other, geometry)
