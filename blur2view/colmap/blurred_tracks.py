"""Keypoints and matches for videos of which every frame is blurred, from a first model that COLMAP made.

Where all frames are blurred SIFT finds few features again, each of them a pixel or more off, and so are the
poses. Corners of each frame, and what was found in it from earlier ones, are looked for in the next frames:
where the first model expects them, by patches blurred alike (`blurred_pose`). They become keypoints and
verified matches of a copy of the project's database, from which COLMAP maps anew.
"""

import sqlite3
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from blur2view.arrays import Array
from blur2view.camera.colmap_camera import normalised_points, to_colmap
from blur2view.colmap.blurred_pose import NEAREST, SMOOTH_PX, Lattice, Search, View
from blur2view.colmap.camera_path import CameraPath
from blur2view.colmap.connection import open_read_only
from blur2view.colmap.exposure_motion import Motion, fit_pose, fit_smears, image_flow
from blur2view.colmap.project import image_names
from blur2view.colmap.recovery import FrameSequence
from blur2view.errors import DatabaseError

BEFORE = 3  # frames, the last, whose keypoints are looked for in a frame
CORNERS, QUALITY, SIGMA_PX = 800, 0.005, 2.0  # corners of a frame, as OpenCV finds them after smoothing
APART_PX = 6.0  # from a corner to the next keypoint
SAME_PX = 1.0  # between places of one keypoint
LEAST_MATCHES = 15  # of a pair
LEVELS = (3, 1, 0)  # of the tracker in each round
VERIFY_PX = 3.0  # of two-view geometries
Found = tuple[NDArray[np.int_], Array]  # numbers of keypoints, and places (N, 2)
NOTHING: Found = np.zeros(0, int), np.zeros((0, 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracks:
    """Keypoints (N, 2), pixels of the working size, by frame, and index pairs (M, 2) by pairs of frames."""

    keypoints: Mapping[str, Array]
    matches: Mapping[tuple[str, str], NDArray[np.uint32]]


class _Keypoints:
    """Keypoints of a frame, which grow."""

    def __init__(self) -> None:
        self.places: Array = np.zeros((0, 2))

    def numbers(self, places: Array) -> list[int]:
        """Return the numbers of keypoints at places (N, 2): new ones where none is within `SAME_PX`."""
        found = []
        for place in places:
            away = np.linalg.norm(self.places - place, axis=1)
            if len(away) and away.min() < SAME_PX:
                found.append(int(away.argmin()))
            else:
                self.places = np.vstack([self.places, place])
                found.append(len(self.places) - 1)
        return found

    def add_corners(self, image: Any) -> None:
        """Add corners of a picture, float32, that are not next to a keypoint."""
        smooth = cv2.GaussianBlur(np.sqrt(np.maximum(image, 0)), (0, 0), SIGMA_PX)
        corners = cv2.goodFeaturesToTrack(smooth, CORNERS, QUALITY, APART_PX)
        for corner in np.zeros((0, 2)) if corners is None else corners[:, 0].astype(float):
            if not len(self.places) or np.linalg.norm(self.places - corner, axis=1).min() > APART_PX:
                self.places = np.vstack([self.places, corner])


def blurred_tracks(
    names: Sequence[str],
    view_of: Callable[[str], View],
    seen: Mapping[str, Array],
    motions: Mapping[str, Array],
) -> Tracks:
    """Return keypoints of frames in order and their matches, each with the `BEFORE` frames before.

    ``seen`` are the points of the model (N, 3) that each frame sees, ``motions`` the motion (6,) of each
    between the frames before and after, by half.
    """
    keypoints = {name: _Keypoints() for name in names}
    matches: dict[tuple[str, str], NDArray[np.uint32]] = {}
    for index, name in enumerate(names):
        before, view = names[max(0, index - BEFORE) : index], view_of(name)
        for one in before:
            other = view_of(one)
            world = _surfaces(other, keypoints[one].places, seen[one])
            found = _found(view, other, world, motions[name])
            if len(found[0]) >= LEAST_MATCHES:
                both = np.column_stack([found[0], keypoints[name].numbers(found[1])]).astype(np.uint32)
                _, first = np.unique(both[:, 1], return_index=True)
                matches[one, name] = both[np.sort(first)]
        keypoints[name].add_corners(view.image)
    return Tracks(keypoints={name: one.places for name, one in keypoints.items()}, matches=matches)


def _surfaces(view: View, pixels: Array, world: Array) -> Array:
    """Return the points (N, 3) of the world at pixels (N, 2), as deep as points that the view sees nearby."""
    points = view.points(world)
    near, index = cKDTree(view.project(world)).query(pixels, k=min(NEAREST, len(world)))
    near, index = near.reshape(len(pixels), -1), index.reshape(len(pixels), -1)
    weight = 1 / (near + SMOOTH_PX) ** 2
    depth = weight.sum(axis=1) / (weight / points[index, 2]).sum(axis=1)
    rays = np.column_stack([normalised_points(view.camera, pixels), np.ones(len(pixels))])
    return np.asarray((rays * depth[:, None] - view.pose[:, 3]) @ view.pose[:, :3])


def _found(view: View, other: View, world: Array, expected: Array) -> Found:
    """Return the numbers of an earlier frame's keypoints that are found in a frame, and their places.

    Each pair has its own blur: what differs between both is how unevenly either of them moved, so that places
    are those of mid exposure in both.
    """
    lattice, motion, everything = Lattice(view.camera), None, [np.ones(len(world), bool)]
    for number, levels in enumerate(LEVELS):
        search = Search.of(view, world, lattice)
        if search is None:
            return NOTHING
        if motion is None:
            flow = image_flow(view.camera, view.points(world)[search.inside])
            rigid = fit_smears(flow, *view.smears(search.pixels[search.inside]), expected)
            motion = Motion(rigid=rigid, bend=np.zeros(3))
        last = number == len(LEVELS) - 1
        found, kernel = search.matches([other], everything, motion, levels, with_kernel=not last)
        if len(found.index) < LEAST_MATCHES:
            return NOTHING
        if not last:
            motion = kernel.corrected(motion, expected)
            fit = world[found.index], found.places, found.covariance
            view = replace(view, pose=fit_pose(view.camera, view.pose, *fit)[0])
    return found.index, found.places


def track_frames(sequence: FrameSequence, database: Path, target: Path) -> float:
    """Write a copy of a project's database with keypoints and matches of a sequence's known frames.

    Returns the median number of a pair's matches. DatabaseError if the project lacks a frame.
    """
    names = sorted(sequence.poses, key=lambda name: sequence.times[name])
    with open_read_only(database) as opened:
        known = image_names(opened)
    if missing := [name for name in names if name not in known]:
        raise DatabaseError(f"{database}: has no image {missing[0]}; name the database of the model")
    times = np.array([sequence.times[name] for name in names], float)
    path = CameraPath(times, np.stack([sequence.poses[name] for name in names]))
    motions = {name: path.expected(time).motion for name, time in zip(names, times, strict=True)}

    def view_of(name: str) -> View:
        return sequence.view(name, sequence.poses[name], sequence.camera_id(name))

    tracks = blurred_tracks(names, view_of, {name: sequence.world_of(name) for name in names}, motions)
    scales = {name: view_of(name).grid.size[0] / view_of(name).camera.width for name in names}
    write_tracks(database, target, tracks, scales, known)
    return float(np.median([len(one) for one in tracks.matches.values()] or [0]))


def write_tracks(
    database: Path, target: Path, tracks: Tracks, scales: Mapping[str, float], known: Mapping[str, int]
) -> None:
    """Write a copy of a project's database with more keypoints, behind its own, and the matches of tracks.

    A pair's matches and geometry are those of the tracks. ``scales`` are the sizes of photographs over those
    that were worked on, ``known`` their ids.
    """
    import pycolmap

    target.unlink(missing_ok=True)
    with open_read_only(database) as source, closing(sqlite3.connect(target)) as copy:
        source.backup(copy)  # pycolmap writes to what it opens
    options = pycolmap.TwoViewGeometryOptions()
    options.compute_relative_pose, options.ransac.max_error, options.ransac.random_seed = True, VERIFY_PX, 0
    first: dict[str, int] = {}
    with pycolmap.Database.open(target) as opened:
        for name, places in tracks.keypoints.items():
            own = opened.read_keypoints(known[name])
            first[name] = len(own)
            width = own.shape[1] if len(own) else 4
            more = np.zeros((len(places), width), np.float32)
            more[:, :2] = to_colmap((places + 0.5) * scales[name] - 0.5)
            more[:, [2, 5] if width == 6 else [2]] = 1  # of scale one
            opened.update_keypoints(known[name], np.vstack([own, more]))
        for (one, other), matches in tracks.matches.items():
            pair = known[one], known[other]
            numbers = (matches + (first[one], first[other])).astype(np.uint32)
            images = [opened.read_image(number) for number in pair]
            cameras = [opened.read_camera(image.camera_id) for image in images]
            points = [opened.read_keypoints(number)[:, :2].astype(float) for number in pair]
            geometry = pycolmap.estimate_calibrated_two_view_geometry(
                cameras[0], points[0], cameras[1], points[1], numbers, options
            )
            if opened.exists_matches(*pair):
                opened.delete_matches(*pair)
            if opened.exists_two_view_geometry(*pair):
                opened.delete_two_view_geometry(*pair)
            opened.write_matches(*pair, numbers)
            opened.write_two_view_geometry(*pair, geometry)
