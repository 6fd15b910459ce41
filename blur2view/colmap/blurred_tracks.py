"""Keypoints and matches for videos whose every frame is blurred, from a first model by COLMAP.

In blurred frames SIFT matches few features, which are off by a pixel or more, and the poses are off as well.
Here corners of each frame, and what was matched in it before, are tracked into the next frames: from where
the first model projects them, by patches of equal blur (`blurred_pose`). They become keypoints and verified
matches in a copy of the project's database, from which COLMAP maps anew.
"""

import sqlite3
from collections.abc import Callable, Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera import normalised_points, to_colmap
from blur2view.colmap.blurred_pose import find_pose
from blur2view.colmap.frame_sequence import FrameSequence
from blur2view.colmap.project import check_schema, image_names, open_read_only, read_camera, read_keypoints
from blur2view.colmap.warped_view import View, inverse_depth_at
from blur2view.images.pixels import to_resized
from blur2view.output import half_written

PAIRED_FRAMES = 3  # the last ones, whose keypoints are tracked into a frame
CORNERS, QUALITY, SIGMA_PX = 800, 0.005, 2.0  # cv2.goodFeaturesToTrack of a frame after smoothing
MIN_SPACING_PX = 6.0  # between a new corner and a keypoint
MERGE_PX = 1.0  # distance of pixels that are one keypoint
MIN_PAIR_MATCHES = 15  # of a pair
VERIFY_PX = 3.0  # maximum error of two-view geometries
SIZES = {2: [], 4: [2], 6: [2, 5]}  # columns of keypoints that say how large they are: scale, or affine shape
Keypoints = dict[str, Array]  # (N, 2) of each frame, pixels of the working size
Matches = dict[tuple[str, str], NDArray[np.uint32]]  # (M, 2) indices of keypoints of each pair of frames


def track_frames(
    sequence: FrameSequence,
    database: Path,
    target: Path,
    show: Callable[[int, int], None] = lambda done, count: None,
) -> None:
    """Write a copy of a database with keypoints of posed frames, matched with `PAIRED_FRAMES` before each."""
    names = sorted(sequence.poses, key=lambda name: sequence.times[name])
    ids = check_project(database, names)
    beside = half_written(target)
    beside.unlink(missing_ok=True)  # a call that was killed left it
    try:
        with open_read_only(database) as source, closing(sqlite3.connect(beside)) as copy:
            source.backup(copy)  # pycolmap changes every database that it opens
        keypoints: Keypoints = {name: np.zeros((0, 2)) for name in names}
        matches: Matches = {}
        for index, name in enumerate(names):
            show(index, len(names))
            for before in names[max(0, index - PAIRED_FRAMES) : index]:
                both = _matches(sequence, name, before, keypoints)
                if len(both) >= MIN_PAIR_MATCHES:
                    matches[before, name] = both
            _indices(keypoints, name, _corners(sequence.view(name).image), MIN_SPACING_PX)
        _write_tracks(beside, sequence, ids, keypoints, matches)
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)


def check_project(database: Path, names: Iterable[str]) -> dict[str, int]:
    """Return the ids of a project's images; DatabaseError if keypoints cannot be added to those named."""
    with open_read_only(database) as source:
        check_schema(source)
        ids = image_names(source)
        for name in names:
            if name not in ids:
                raise ValueError(f"has no image {name}; name the database of the model")
            read_keypoints(source, ids[name])
            camera = source.execute("SELECT camera_id FROM images WHERE image_id = ?", (ids[name],))
            read_camera(source, camera.fetchone()[0])
    return ids


def _indices(keypoints: Keypoints, name: str, pixels: Array, spacing_px: float) -> list[int]:
    """Return the indices of a frame's keypoints at pixels (N, 2); new ones where none is so near."""
    indices = []
    for pixel in pixels:
        distance = np.linalg.norm(keypoints[name] - pixel, axis=1)
        if not len(distance) or distance.min() > spacing_px:
            keypoints[name], distance = np.vstack([keypoints[name], pixel]), np.append(distance, 0.0)
        indices.append(int(distance.argmin()))
    return indices


def _corners(image: Any) -> Array:
    """Return corners (N, 2) of a picture, float32."""
    smooth = cv2.GaussianBlur(np.sqrt(np.maximum(image, 0)), (0, 0), SIGMA_PX)
    corners = cv2.goodFeaturesToTrack(smooth, CORNERS, QUALITY, MIN_SPACING_PX)
    return np.zeros((0, 2)) if corners is None else corners[:, 0].astype(float)


def _matches(sequence: FrameSequence, name: str, before: str, keypoints: Keypoints) -> NDArray[np.uint32]:
    """Track an earlier frame's keypoints into a frame: indices (M, 2) of keypoints of both."""
    other, expected = sequence.view(before), sequence.expected(name)
    world = _surfaces(other, keypoints[before], sequence.world(sequence.observed_points(before)))
    seen, pose = np.ones(len(world), bool), None
    if expected is not None:
        pose = find_pose(sequence.view(name), [other], world, [seen], expected.motion)
    if pose is None:
        return np.zeros((0, 2), np.uint32)
    indices = _indices(keypoints, name, pose.pixels, MERGE_PX)
    _, first = np.unique(indices, return_index=True)
    return np.column_stack([pose.numbers, indices]).astype(np.uint32)[np.sort(first)]


def _surfaces(view: View, pixels: Array, world: Array) -> Array:
    """Return the points (N, 3) of the world at pixels (N, 2), as deep as points that the view sees nearby."""
    depth = 1 / inverse_depth_at(pixels, view.project(world), view.points(world)[:, 2])
    rays = np.column_stack([normalised_points(view.camera, pixels), np.ones(len(pixels))])
    return np.asarray((rays * depth[:, None] - view.pose[:, 3]) @ view.pose[:, :3])


def _write_tracks(
    path: Path, sequence: FrameSequence, ids: dict[str, int], keypoints: Keypoints, matches: Matches
) -> None:
    """Write keypoints behind those of a database's images, and matches in place of those of their pairs."""
    import pycolmap

    with pycolmap.Database.open(path) as opened:
        first = {}  # index of each frame's first new keypoint
        for name, pixels in keypoints.items():
            own, camera = opened.read_keypoints(ids[name]), opened.read_image(ids[name]).camera_id
            scale = opened.read_camera(camera).width / sequence.view(name).camera.width
            columns = own.shape[1] if len(own) else 4
            more = np.zeros((len(pixels), columns), np.float32)
            more[:, :2] = to_colmap(to_resized(pixels, scale))
            more[:, SIZES[columns]] = 1
            put = opened.update_keypoints if opened.exists_keypoints(ids[name]) else opened.write_keypoints
            put(ids[name], np.vstack([own.reshape(-1, columns), more]))
            first[name] = len(own)
        for (earlier, later), both in matches.items():
            indices = (both + (first[earlier], first[later])).astype(np.uint32)
            _write_pair(opened, ids[earlier], ids[later], indices)


def _write_pair(opened: Any, image1: int, image2: int, indices: NDArray[np.uint32]) -> None:
    """Write the matches (M, 2) of a pair of images and their two-view geometry in place of its own."""
    import pycolmap

    options = pycolmap.TwoViewGeometryOptions()
    options.compute_relative_pose, options.ransac.max_error, options.ransac.random_seed = True, VERIFY_PX, 0
    cameras = [opened.read_camera(opened.read_image(number).camera_id) for number in (image1, image2)]
    points = [opened.read_keypoints(number)[:, :2].astype(float) for number in (image1, image2)]
    geometry = pycolmap.estimate_calibrated_two_view_geometry(
        cameras[0], points[0], cameras[1], points[1], indices, options
    )
    opened.delete_matches(image1, image2)
    opened.delete_two_view_geometry(image1, image2)
    opened.write_matches(image1, image2, indices)
    opened.write_two_view_geometry(image1, image2, geometry)
