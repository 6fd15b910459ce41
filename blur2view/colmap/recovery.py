"""Frames that a COLMAP model lacks, as they are too blurred for it, put into it.

Where a frame is expected a spline through the poses of the frames before and after it says, and frames that
are known say how far off such a spline is. From there blur-matched patches of registered neighbours give its
pose (`blurred_pose`). Both are averaged by their covariances. A frame that does not agree with its
neighbours, or in which too little is found, is refused with the reason: ``python -m
tools.evaluation.recovered`` measures what comes of it.
"""

import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.camera import to_colmap
from blur2view.colmap.blur_matching import linear_light
from blur2view.colmap.blurred_pose import BlurredPose, View, find_pose
from blur2view.colmap.exposure_motion import Motion, projected
from blur2view.colmap.models import add_image, observed, photographs_of, read_model
from blur2view.errors import DatabaseError, ImageError
from blur2view.exposure.time_direction import frame_times
from blur2view.exposure.trajectory import MEDIAN_OF_THREE, CameraPath, Expected, change_of, changed
from blur2view.exposure.views import CLOSE, OPEN
from blur2view.images.image import read_pixels
from blur2view.networks.protocol import SmearReader
from blur2view.networks.smear_network import SmearNetwork

WORK_SIDE = 960  # pixels: larger photographs are worked on in this size
PICTURES_KEPT = 16  # pictures in memory
NEIGHBOURS = 4  # registered frames, the nearest, in which patches are taken
NEAR_FRAMES = 12  # frames to the nearest registered one
LEAST_POINTS = 30  # that a frame must see
LEAST_FOUND = 0.1  # share of those looked for
MOST_RESIDUAL_PX = 3.0  # of the points found, median, in the working size
MOST_DEPARTURE = 6.0  # standard deviations of the spline
MOST_CHANGE = 0.7  # of the smears' rotation, by which the neighbours correct it
SURE_SHARE = 0.5  # of the points looked for: where more are found smears may be wrong
# The next four are of 69 rendered frames, runs of 3 of tools.evaluation.recovered with shakes of 10, 30 and
# 60 px, by likelihood and coverage: 90 % hold at 90 %
INDEPENDENT = 0.01  # of the matches: a point is found in several neighbours, and patches overlap
KERNEL_ERROR = 0.01  # standard deviation that the blur leaves, of rotation and translation of the exposure
BEND_ERROR = 0.04  # the same of an uneven motion, of its bend
LEAST_ERROR_RAD = 4e-4  # of a rotation, in which cameras and points err together


class RecoveredFrame(NamedTuple):
    """A frame with its pose."""

    pose: Array  # (3, 4) cam_from_world at mid exposure
    covariance: Array  # (6, 6) of a small rotation (radians) and translation of points in the camera
    motion: Motion  # during the exposure, in the sense of time of the frames
    points: Array  # (M,) ids of the model's points that were found
    places: Array  # (M, 2) where, pixels of the frame's own size
    residual_px: float  # median distance of the places from the points' projections


class Recovery(NamedTuple):
    """A model with frames that it lacked, by name, why others are refused, and all that is known of them."""

    model: Any  # with views NAME#open and NAME#close of recovered frames, which observe its points
    recovered: Mapping[str, RecoveredFrame]
    refused: Mapping[str, str]
    sequence: "FrameSequence"


def recover_frames(
    model: str | os.PathLike[str],
    frames: str | os.PathLike[str],
    names: Sequence[str],
    *,
    refine: bool = False,
    network: SmearReader | None = None,
    show: Callable[[int, int], None] = lambda done, count: None,
) -> Recovery:
    """Return the model in a folder with those frames of a video, in another folder, that it lacks.

    ``names`` are all frames in order, as COLMAP calls them; where their numbers leave some out, none are
    neighbours. With ``refine`` recovered poses and points are adjusted together at the end. ``show`` gets
    how many frames are done, of how many. DatabaseError if the model has fewer than two of the frames.
    """
    sequence = FrameSequence(read_model(Path(model)), Path(frames), names, network or SmearNetwork())
    if len(sequence.images) < 2:
        count = f"has {len(sequence.images)} of the {len(names)} frames in {frames}"
        raise DatabaseError(f"{model}: {count}; name the folder that COLMAP read them from")
    found = sequence.recover([name for name in names if name not in sequence.images], show)
    recovered = {name: one for name in names if isinstance(one := found.get(name), RecoveredFrame)}
    refused = {name: one for name in names if isinstance(one := found.get(name), str)}
    for name, frame in recovered.items():
        _add_frame(sequence, name, frame)
    if refine and recovered:
        _refine(sequence.model, recovered.keys())
    for name, frame in recovered.items():
        _add_views(sequence.model, name, frame)
    return Recovery(sequence.model, recovered, refused, sequence)


class FrameSequence:
    """The frames of a video, some in a model: ``poses`` of those registered and recovered."""

    def __init__(self, model: Any, folder: Path, names: Sequence[str], network: SmearReader) -> None:
        self.model, self.folder, self.network = model, folder, network
        self.times = dict(zip(names, frame_times(names), strict=True))
        self.images = {name: one for name, one in photographs_of(model).items() if name in self.times}
        self.poses = {name: image.cam_from_world().matrix() for name, image in self.images.items()}
        self._read = lru_cache(PICTURES_KEPT)(self._read_frame)

    def recover(
        self, names: Sequence[str], show: Callable[[int, int], None]
    ) -> dict[str, RecoveredFrame | str]:
        """Return frames that can be recovered, or why one cannot; those next to registered ones first."""
        found = dict[str, RecoveredFrame | str]()
        for name in sorted(names, key=lambda name: (self._away(name, self.near(name)[0]), self.times[name])):
            show(len(found), len(names))
            try:
                one = found[name] = self._recover_one(name)
            except ImageError as error:
                one = found[name] = str(error)
            if isinstance(one, RecoveredFrame):
                self.poses[name] = one.pose
        return found

    def near(self, name: str) -> list[str]:
        """Return registered frames, the nearest in time first: itself, if it is one."""
        return sorted(self.images, key=lambda other: (self._away(name, other), self.times[other]))

    def _away(self, name: str, other: str) -> int:
        """Return how many frames lie between two."""
        return abs(self.times[name] - self.times[other])

    def expected(self, name: str) -> Expected | None:
        """Return where the other frames' path expects a frame; None where fewer than two are near."""
        times = np.array([self.times[one] for one in self.poses], float)
        return CameraPath(times, np.stack(list(self.poses.values())), NEAR_FRAMES).expected(self.times[name])

    def view(self, name: str, pose: Array) -> View:
        """Return a frame at a pose, in the working size."""
        return replace(self._read(name), pose=pose)

    def _read_frame(self, name: str) -> View:
        """Return a frame in the working size, with the nearest frame's camera."""
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

    def _recover_one(self, name: str) -> RecoveredFrame | str:
        """Return a frame with its pose, or why there is none."""
        expected, near = self.expected(name), self.near(name)[:NEIGHBOURS]
        if expected is None:
            return f"fewer than two registered frames are within {NEAR_FRAMES} frames"
        view = self.view(name, expected.pose)
        neighbours = [self.view(one, self.poses[one]) for one in near]
        seen = [self.points_of(one) for one in near]
        ids = np.array(sorted(set().union(*seen)))
        masks = [np.isin(ids, list(one)) for one in seen]
        found = find_pose(view, neighbours, self.world(ids), masks, expected.motion)
        reason = refusal(found, expected)
        if found is None or reason:
            return reason
        scale = view.grid.size[0] / view.camera.width
        places, residual = (found.places + 0.5) * scale - 0.5, found.residual_px * scale
        return RecoveredFrame(*weighed(found, expected), found.motion, ids[found.numbers], places, residual)

    def points_of(self, name: str) -> set[int]:
        """Return the ids of the points that a registered frame sees, or the one next to it."""
        return set(observed(self.model, self.images[self.near(name)[0]]).values())

    def world(self, ids: Iterable[int]) -> Array:
        """Return points (N, 3) by their ids."""
        return np.array([self.model.points3D[number].xyz for number in ids]).reshape(-1, 3)


def weighed(found: BlurredPose, expected: Expected) -> tuple[Array, Array]:
    """Return the weighted mean of poses found and expected, and its covariance (6, 6), `BEND_ERROR` added."""
    matches = np.linalg.pinv(found.information * INDEPENDENT, hermitian=True)
    own, even = (matches + _shared_error(found, bend) for bend in (BEND_ERROR, 0.0))
    if not np.isfinite([expected.rotation_rad, expected.position]).all():
        return found.pose, own
    prior = np.diag(np.repeat([expected.rotation_rad, expected.position], 3) ** 2)
    gain = even @ np.linalg.inv(even + prior)
    pose, kept = changed(found.pose, gain @ change_of(found.pose, expected.pose)), np.eye(6) - gain
    return pose, kept @ own @ kept.T + gain @ prior @ gain.T


def _shared_error(found: BlurredPose, bend: float) -> Array:
    """Return the covariance (6, 6) of what all matches have in common, with such a share of the bend."""
    turned, moved = (np.linalg.norm(one) for one in np.split(found.motion.rigid, 2))
    share = np.hypot(KERNEL_ERROR, bend * np.linalg.norm(found.motion.bend) / (turned + TINY))
    return np.diag(np.repeat([np.hypot(share * turned, LEAST_ERROR_RAD), share * moved], 3) ** 2)


def refusal(found: BlurredPose | None, expected: Expected) -> str:
    """Return why a pose is not believed, empty if it is."""
    if found is None or len(found.numbers) < max(LEAST_POINTS, LEAST_FOUND * found.tried):
        return "too few points of its neighbours are found in it"
    if found.residual_px > MOST_RESIDUAL_PX:
        return "its points are not where the pose has them"
    change = change_of(found.pose, expected.pose)
    turned = float(np.linalg.norm(change[:3])) / expected.rotation_rad
    moved = float(np.linalg.norm(change[3:])) / expected.position
    if max(turned, moved) > MOST_DEPARTURE * MEDIAN_OF_THREE:
        return "its pose is too far off its neighbours' path"
    smears = found.smear_motion[:3]
    corrected = float(np.linalg.norm(found.motion.rigid[:3] - smears) / (np.linalg.norm(smears) + TINY))
    unsure = len(found.numbers) < SURE_SHARE * found.tried
    if unsure and corrected > MOST_CHANGE and np.linalg.norm(smears) > expected.rotation_rad:
        return "its smears differ from the blur that its neighbours show"
    return ""


def _add_frame(sequence: FrameSequence, name: str, frame: RecoveredFrame) -> None:
    """Add a frame to a model, and what it observes to the tracks."""
    import pycolmap

    beside = sequence.images[sequence.near(name)[0]]
    image = add_image(sequence.model, name, frame.pose, to_colmap(frame.places), beside)
    for place, number in enumerate(frame.points):
        sequence.model.add_observation(int(number), pycolmap.TrackElement(image.image_id, place))


def _add_views(model: Any, name: str, frame: RecoveredFrame) -> None:
    """Add both ends of a frame's exposure, with the keypoints of its points as they are seen there."""
    image = model.find_image_with_name(name)
    world = np.array([model.points3D[int(number)].xyz for number in frame.points])
    for end, t in ((OPEN, -0.5), (CLOSE, 0.5)):
        pose = frame.motion.pose_at(t, image.cam_from_world().matrix())
        pixels = projected(model.cameras[image.camera_id], world @ pose[:, :3].T + pose[:, 3])
        keypoints = to_colmap(np.where(np.isfinite(pixels), pixels, frame.places))
        add_image(model, name + end, pose, keypoints, image)


def _refine(model: Any, recovered: Collection[str]) -> None:
    """Adjust the poses of recovered frames and the points; the user's frames and cameras stay as they are."""
    import pycolmap

    options, config = pycolmap.BundleAdjustmentOptions(), pycolmap.BundleAdjustmentConfig()
    options.refine_focal_length = options.refine_extra_params = options.refine_principal_point = False
    options.print_summary, options.min_track_length = False, 2
    for image in photographs_of(model).values():
        config.add_image(image.image_id)
        if image.name not in recovered:
            config.set_constant_rig_from_world_pose(image.frame_id)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
