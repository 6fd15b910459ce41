"""Frames that are too blurred for COLMAP, registered in its model of the others.

A spline through the poses of the frames before and after predicts where a frame is, and known frames show how
far off such a spline is. From there blur-matched patches of registered neighbours give the pose
(`blurred_pose`); both are averaged by their covariances. A frame that contradicts its neighbours, or in which
too few points are found, is refused with the reason. Measured by ``python -m tools.evaluation.recovered``.
"""

import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.camera import to_colmap
from blur2view.colmap.blur_matching import linear_light
from blur2view.colmap.blurred_pose import BlurredPose, View, find_pose, pose_at, projected
from blur2view.colmap.models import add_image, observed, photographs_of, read_model
from blur2view.errors import DatabaseError, ImageError
from blur2view.exposure.sequence import frame_names, frame_times
from blur2view.exposure.trajectory import MEDIAN_OF_THREE, CameraPath, Expected, change_of, changed
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.images.image import read_pixels
from blur2view.networks.smear_network import SmearNetwork, SmearReader

WORK_SIDE = 960  # pixels: larger photographs are reduced to this side
PICTURES_KEPT = 16  # pictures in memory
NEIGHBOURS = 4  # registered frames, the nearest, whose patches are matched
NEAR_FRAMES = 12  # frame intervals from a frame to those that predict it
MIN_POINTS = 30  # that are found in a frame
MIN_FOUND = 0.1  # share of the points in the picture that are found
MAX_RESIDUAL_PX = 3.0  # of the points found, median, in the working size
MAX_DEPARTURE = 6.0  # standard deviations of the spline
MAX_CORRECTION = 0.7  # of the smears' rotation, relative, where fewer points are found than
SURE_FOUND = 0.5  # share of the points in the picture
# The next four are of 69 rendered frames, runs of 3 of tools.evaluation.recovered with shakes of 10, 30 and
# 60 px, by likelihood and coverage: 90 % hold at 90 %
INDEPENDENT_SHARE = 0.01  # share of the matches: a point is found in several neighbours, and patches overlap
KERNEL_ERROR = 0.01  # standard deviation, relative to the motion, that the blur leaves in a pose
BEND_ERROR = 0.04  # the same, relative to the bend
MIN_ERROR_RAD = 4e-4  # of a rotation, in which cameras and points err together


@dataclass(frozen=True, kw_only=True, eq=False)
class RecoveredFrame:
    """A frame that the model lacked, with its pose."""

    pose: Array  # (3, 4) cam_from_world at mid exposure
    covariance: Array  # (6, 6) of a small rotation (radians) and translation of points in the camera
    motion: Array  # (9,) during the exposure, as in `blurred_pose`, in the frames' sense of time
    points: NDArray[np.int_]  # (M,) ids of the model's points that were found
    pixels: Array  # (M, 2) where they were found, in the frame's own size
    residual_px: float  # median distance of the pixels from the points' projections

    def pose_at(self, time: float) -> Array:
        """Return cam_from_world (3, 4) at a time of the exposure: -1/2 at shutter-open, 1/2 at close."""
        return pose_at(time, self.pose, self.motion)


@dataclass(frozen=True, kw_only=True, eq=False)
class Recovery:
    """COLMAP's model of a video, and what became of the frames that it lacked."""

    model: Any
    """pycolmap.Reconstruction with the recovered frames, and their views where these were asked for."""
    registered: tuple[str, ...]  # frames that the model had, in order of time
    recovered: Mapping[str, RecoveredFrame]  # by name, in order of time
    refused: Mapping[str, str]  # why every other frame is not believed or cannot be read
    sequence: "FrameSequence"  # with which `track_frames` goes on


class FrameSequence:
    """The frames of a video in order, those that a model has, and those that are ``recovered`` or not."""

    def __init__(self, model: Any, folder: Path, names: Sequence[str], network: SmearReader) -> None:
        self.model, self.folder, self.network = model, folder, network
        self.times = dict(zip(names, frame_times(names), strict=True))
        self.images = {name: image for name, image in photographs_of(model).items() if name in self.times}
        self.poses = {name: image.cam_from_world().matrix() for name, image in self.images.items()}
        self.recovered = dict[str, RecoveredFrame]()  # in order of time
        self.refused = dict[str, str]()  # the reason, in order of time
        self._read = lru_cache(PICTURES_KEPT)(self._read_frame)

    def recover(self, show: Callable[[int, int], None]) -> None:
        """Recover frames or refuse them, those next to registered ones first; ``poses`` grow."""
        missing = [name for name in self.times if name not in self.images]
        gaps = {name: min(self._apart(name, known) for known in self.images) for name in missing}
        for done, name in enumerate(sorted(missing, key=lambda name: gaps[name])):
            show(done, len(missing))
            try:
                self.recovered[name] = self._recover_one(name)
                self.poses[name] = self.recovered[name].pose
            except ImageError as error:
                self.refused[name] = str(error)
            except (ValueError, ArithmeticError, cv2.error):  # of numbers that fit no motion
                self.refused[name] = NO_FIT
        self.recovered = {name: self.recovered[name] for name in missing if name in self.recovered}
        self.refused = {name: self.refused[name] for name in missing if name in self.refused}

    def near(self, name: str) -> list[str]:
        """Return the registered frames, the nearest in time first: itself, if it is one."""
        return sorted(self.images, key=lambda known: (self._apart(name, known), self.times[known]))

    def _apart(self, name: str, other: str) -> float:
        return abs(self.times[name] - self.times[other])

    def expected(self, name: str) -> Expected | None:
        """Predict a frame by the path of the others; None where fewer than two are near."""
        times = np.array([self.times[known] for known in self.poses], float)
        return CameraPath(times, np.stack(list(self.poses.values())), NEAR_FRAMES).expected(self.times[name])

    def view(self, name: str, pose: Array | None = None) -> View:
        """Return a frame in the working size at a pose (3, 4), by default its own."""
        return replace(self._read(name), pose=self.poses[name] if pose is None else pose)

    def _read_frame(self, name: str) -> View:
        """Read a frame, with the camera of the nearest registered one."""
        pixels = read_pixels(self.folder / name, as_stored=True)
        height, width = pixels.shape[:2]
        camera = self.model.cameras[self.images[self.near(name)[0]].camera_id]
        if (camera.width, camera.height) != (width, height):
            raise ImageError(
                f"{self.folder / name}: is of {width}x{height} pixels, its camera of "
                f"{camera.width}x{camera.height}; name the folder that COLMAP read"
            )
        light = linear_light(pixels / np.float32(255 if pixels.dtype == np.uint8 else 65535))
        view = View(image=light, grid=self.network.predict(pixels), camera=camera, pose=np.eye(3, 4))
        return view.scaled(min(1.0, WORK_SIDE / max(width, height)))

    def _recover_one(self, name: str) -> RecoveredFrame:
        """Return a frame with its pose; ImageError with the reason if there is none."""
        expected, near = self.expected(name), self.near(name)[:NEIGHBOURS]
        if expected is None:
            raise ImageError(TOO_FAR)
        view = self.view(name, expected.pose)
        neighbours = [self.view(neighbour) for neighbour in near]
        seen = [self.points_of(neighbour) for neighbour in near]
        ids = np.array(sorted(set().union(*seen)))
        masks = [np.isin(ids, list(points)) for points in seen]
        found = find_pose(view, neighbours, self.world(ids), masks, expected.motion)
        if found is None or (reason := refusal(found, expected)):
            raise ImageError(TOO_FEW if found is None else reason)
        pose, covariance = weighted_mean(found, expected)
        scale = view.grid.size[0] / view.camera.width
        return RecoveredFrame(
            pose=pose,
            covariance=covariance,
            motion=found.motion,
            points=ids[found.numbers],
            pixels=(found.pixels + 0.5) * scale - 0.5,
            residual_px=found.residual_px * scale,
        )

    def points_of(self, name: str) -> set[int]:
        """Return the ids of the points that a registered frame sees, or the nearest one to a frame."""
        return set(observed(self.model, self.images[self.near(name)[0]]).values())

    def world(self, ids: Iterable[int]) -> Array:
        """Return points (N, 3) by their ids."""
        return np.array([self.model.points3D[int(number)].xyz for number in ids]).reshape(-1, 3)


def recover_frames(
    model: str | os.PathLike[str],
    frames: str | os.PathLike[str],
    names: Sequence[str] | None = None,
    *,
    views: bool | None = None,
    refine: bool = False,
    network: SmearReader | None = None,
    show: Callable[[int, int], None] = lambda done, count: None,
) -> Recovery:
    """Register the frames of a video that COLMAP's model lacks; frames of the model keep their poses.

    Recovered frames observe points of the model. Nothing is written: `Recovery.model` is pycolmap's.

    Parameters
    ----------
    model
        Folder of COLMAP's model, with two frames or more.
    frames
        Folder of the frames, all of one video.
    names
        All frames in order, as COLMAP calls them: their paths in ``frames``; by default all photographs in
        that folder and below it. The numbers in names that differ in nothing else are times (`frame_times`).
    views
        Whether a recovered frame's poses at shutter-open and shutter-close become images NAME#open and
        NAME#close, for which there are no files; by default if the model has such images.
    refine
        Whether recovered poses and the model's points are adjusted together.
    network
        Reads smears; by default a new `SmearNetwork`.
    show
        Gets how many frames are done, of how many.

    Raises
    ------
    DatabaseError
        If the model cannot be read, or has fewer than two of the frames.
    """
    names = frame_names(frames) if names is None else names
    sequence = FrameSequence(read_model(Path(model)), Path(frames), names, network or SmearNetwork())
    if len(sequence.images) < 2:
        count = f"has {len(sequence.images)} of the {len(names)} frames in {frames}"
        raise DatabaseError(f"{model}: {count}; name the folder that COLMAP read them from")
    sequence.recover(show)
    return recovery_of(sequence, views=views, refine=refine)


def recovery_of(sequence: FrameSequence, *, views: bool | None = None, refine: bool = False) -> Recovery:
    """Return a sequence's model to which its recovered frames are added, as `recover_frames` says."""
    if views is None:
        views = any(image.name.endswith((OPEN, CLOSE)) for image in sequence.model.images.values())
    for name in sequence.recovered:
        _add_frame(sequence, name)
    if refine and sequence.recovered:
        adjust(sequence.model, sequence.recovered)
    for name in sequence.recovered if views else ():
        _add_views(sequence, name)
    return Recovery(
        model=sequence.model,
        registered=tuple(name for name in sequence.times if name in sequence.images),
        recovered=sequence.recovered,
        refused=sequence.refused,
        sequence=sequence,
    )


TOO_FEW = "too few points of its neighbours are found in it"
NO_FIT = "no motion fits what is found in it"
TOO_FAR = f"fewer than two registered frames lie within {NEAR_FRAMES} frame intervals, by their numbers"


def refusal(found: BlurredPose, expected: Expected) -> str:
    """Return why a pose is not believed, empty if it is."""
    if len(found.numbers) < max(MIN_POINTS, MIN_FOUND * found.tried):
        return TOO_FEW
    if found.residual_px > MAX_RESIDUAL_PX:
        return "its points are not where the pose has them"
    change = change_of(found.pose, expected.pose)
    turned = float(np.linalg.norm(change[:3])) / expected.rotation_rad
    moved = float(np.linalg.norm(change[3:])) / expected.position
    if max(turned, moved) > MAX_DEPARTURE * MEDIAN_OF_THREE:
        return "its pose is too far off its neighbours' path"
    smears = found.smear_motion[:3]
    corrected = float(np.linalg.norm(found.motion[:3] - smears) / (np.linalg.norm(smears) + TINY))
    unsure = len(found.numbers) < SURE_FOUND * found.tried
    if unsure and corrected > MAX_CORRECTION and np.linalg.norm(smears) > expected.rotation_rad:
        return "its smears differ from the blur that its neighbours show"
    return ""


def weighted_mean(found: BlurredPose, expected: Expected) -> tuple[Array, Array]:
    """Return the mean of the poses found and expected, weighted without the bend, and its covariance."""
    matches = np.asarray(np.linalg.pinv(found.information * INDEPENDENT_SHARE, hermitian=True), float)
    turned, moved, bent = (np.linalg.norm(part) for part in np.split(found.motion, 3))
    shares = [np.hypot(KERNEL_ERROR, error * bent / (turned + TINY)) for error in (BEND_ERROR, 0.0)]
    shared = [np.repeat([np.hypot(share * turned, MIN_ERROR_RAD), share * moved], 3) ** 2 for share in shares]
    own, even = (matches + np.diag(squared) for squared in shared)
    if not np.isfinite([expected.rotation_rad, expected.position]).all():
        return found.pose, own
    prior = np.diag(np.repeat([expected.rotation_rad, expected.position], 3) ** 2)
    gain = even @ np.linalg.inv(even + prior)
    pose, kept = changed(found.pose, gain @ change_of(found.pose, expected.pose)), np.eye(6) - gain
    return pose, kept @ own @ kept.T + gain @ prior @ gain.T


def _add_frame(sequence: FrameSequence, name: str) -> None:
    """Add a recovered frame to the model, and its observations to the tracks."""
    import pycolmap

    frame, beside = sequence.recovered[name], sequence.images[sequence.near(name)[0]]
    image = add_image(sequence.model, name, frame.pose, to_colmap(frame.pixels), beside)
    for keypoint, number in enumerate(frame.points):
        sequence.model.add_observation(int(number), pycolmap.TrackElement(image.image_id, keypoint))


def _add_views(sequence: FrameSequence, name: str) -> None:
    """Add both ends of a recovered frame's exposure, with the projections of its points as keypoints."""
    model, frame = sequence.model, sequence.recovered[name]
    image, world = model.find_image_with_name(name), sequence.world(frame.points)
    for end, t in ((OPEN, -0.5), (CLOSE, 0.5)):
        pose = pose_at(t, image.cam_from_world().matrix(), frame.motion)
        pixels = projected(model.cameras[image.camera_id], world @ pose[:, :3].T + pose[:, 3])
        keypoints = to_colmap(np.where(np.isfinite(pixels), pixels, frame.pixels))
        add_image(model, name + end, pose, keypoints, image)


def adjust(model: Any, free: Collection[str]) -> None:
    """Adjust the points of a model and the poses of its images named ``free``; all else stays."""
    import pycolmap

    options, config = pycolmap.BundleAdjustmentOptions(), pycolmap.BundleAdjustmentConfig()
    options.refine_focal_length = options.refine_extra_params = options.refine_principal_point = False
    options.print_summary, options.min_track_length = False, 2
    for image in photographs_of(model).values():
        config.add_image(image.image_id)
        if image.name not in free:
            config.set_constant_rig_from_world_pose(image.frame_id)
    adjusted = deepcopy(model)
    for number, point in model.points3D.items():
        if point.track.length() < 2:  # on which pycolmap ends
            adjusted.delete_point3D(number)
    pycolmap.create_default_bundle_adjuster(options, config, adjusted).solve()
    for number, point in adjusted.points3D.items():
        model.points3D[number].xyz = point.xyz
    for image in photographs_of(model).values():
        if image.name in free:
            image.frame.rig_from_world = adjusted.images[image.image_id].frame.rig_from_world
