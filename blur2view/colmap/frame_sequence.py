"""The poses of the frames of a video that COLMAP's model of the others lacks.

A spline through the poses of the frames before and after predicts where a frame is, and known frames show how
far off such a spline is. From there blur-matched patches of registered neighbours give the pose
(`blurred_pose`); both are averaged by their covariances. A frame that contradicts its neighbours, or in which
too few points are found, is refused with the reason. Measured by ``python -m tools.evaluation.recovered``.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.camera import from_colmap
from blur2view.colmap.blur_matching import linear_light
from blur2view.colmap.blurred_pose import BlurredPose, find_pose, pose_at, searched_pose
from blur2view.colmap.models import observed, read_model, registered_images
from blur2view.colmap.warped_view import View, projected
from blur2view.errors import DatabaseError, ImageError
from blur2view.exposure.sequence import frame_times
from blur2view.exposure.trajectory import MEDIAN_OF_THREE, CameraPath, Expected, changed, relative_motion
from blur2view.images.image import read_picture
from blur2view.images.pixels import to_resized
from blur2view.networks.smear_network import SmearReader

WORK_SIDE = 960  # pixels: larger photographs are reduced to this side
PICTURES_KEPT = 16  # pictures in memory
MATCHED_NEIGHBOURS = 4  # registered frames, the nearest, whose patches are matched
NEAR_FRAMES = 12  # frame intervals from a frame to those that predict it
MIN_POINTS = 30  # that are found in a frame
MIN_FOUND = 0.1  # share of the points in the picture that are found
MAX_RESIDUAL_PX = 3.0  # of the points found, median, in the working size
MAX_DEPARTURE = 6.0  # standard deviations of the spline
WEAK_SHARE = 0.5  # of the points that the median frame sees: fewer are few
MAX_RESIDUAL = 2.0  # of a frame with few, of the median frame's distance of keypoints from its points
LEAST_RESIDUAL_PX = 0.1  # of that frame: where it is less, COLMAP's keypoints are no better than this
MAX_CORRECTION = 0.7  # of the smears' rotation, relative, where fewer points are found than
SURE_FOUND = 0.5  # share of the points in the picture
# These and SPLINE_TAIL by likelihood and coverage of 11 rendered frames, runs of 3 of
# tools.evaluation.recovered with shakes of 10 and 30 px, and of RedKitchen's runs of 3 with smears of 6 to
# 53 px and of 6 at 38 px: 90 % hold at 90 %. The share was 0.007 while each point was searched from all four
# neighbours; with fewer matches 0.01 states regions of the same size
INDEPENDENT_SHARE = 0.01  # share of the matches: a point is found in several neighbours, and patches overlap
KERNEL_ERROR = 0.01  # standard deviation, relative to the motion, that the blur leaves in a pose
BEND_ERROR = 0.04  # the same, relative to the bend
MIN_ERROR_RAD = 4e-4  # of a rotation, in which cameras and points err together
SPLINE_TAIL = 2.0  # factor of a spline's median error: some frames are shaken much farther than most
TOO_FEW = "too few of its neighbours' points are found in it"
NO_FIT = "no motion fits what is found in it"
# also half a frame before and after it
TOO_FAR = f"fewer than two registered frames lie within {NEAR_FRAMES - 1} frame intervals, by their numbers"


@dataclass(frozen=True, kw_only=True, eq=False)
class RecoveredFrame:
    """A frame that the model lacked, with its pose."""

    pose: Array  # (3, 4) cam_from_world at mid exposure
    covariance: Array  # (6, 6) of a small rotation (radians) and translation of points in the camera
    motion: Array  # (9,) during the exposure, as in `blurred_pose`, in the frames' sense of time
    motion_covariance: Array  # (9, 9) of what the neighbours' pictures say of it
    points: NDArray[np.int_]  # (M,) ids of the model's points that were found
    pixels: Array  # (M, 2) where they were found, in the frame's own size
    residual_px: float  # median distance of the pixels from the points' projections

    def pose_at(self, time: float) -> Array:
        """Return cam_from_world (3, 4) at a time of the exposure: -1/2 at shutter-open, 1/2 at close."""
        return pose_at(time, self.pose, self.motion)

    def turning(self) -> tuple[float, float]:
        """Return by how much the camera turned during the exposure, and its deviation, radians.

        Of 14 and 20 recovered frames of two rendered videos errors are 0.66 and 0.58 deviations (median), and
        1.4 and 1.2 of these hold 90 %.
        """
        angle = float(np.linalg.norm(relative_motion(self.pose_at(-0.5), self.pose_at(0.5))[:3]))
        axis = self.motion[:3] / (np.linalg.norm(self.motion[:3]) + TINY)
        variance = float(axis @ self.motion_covariance[:3, :3] @ axis)
        return angle, float(np.hypot(np.sqrt(variance), KERNEL_ERROR * angle))


class FrameSequence:
    """The frames of a video in order, those that a model has, and those that are ``recovered`` or not.

    Frames that are ``set_aside`` are recovered as if the model lacked them, and keep its pose if that fails.
    """

    def __init__(self, model: Path, folder: Path, names: Sequence[str], network: SmearReader) -> None:
        self.source, self.model, self.folder, self.network = model, read_model(model), folder, network
        self.times = dict(zip(names, frame_times(names), strict=True))
        registered = registered_images(self.model)
        self.images = {name: image for name, image in registered.items() if name in self.times}
        self.poses = {name: image.cam_from_world().matrix() for name, image in self.images.items()}
        self.aside = dict[str, Any]()
        self.recovered = dict[str, RecoveredFrame]()
        self.refused = dict[str, str]()  # the reason
        self._read = lru_cache(PICTURES_KEPT)(self._read_frame)
        self._observed = lru_cache(len(names))(self._read_observed)
        if len(self.images) < 2:
            count = f"{len(self.images)} of its {len(registered)} images are in {folder}, but two are needed"
            raise DatabaseError(f"{model}: {count}; name the folder from which COLMAP read them")

    def absent(self) -> list[str]:
        """Return the registered images of the model that are not among the frames, by name."""
        return sorted(name for name in registered_images(self.model) if name not in self.times)

    def set_aside(self, names: Collection[str]) -> None:
        """Set registered frames aside: they predict no frame, and no patch of theirs is searched.

        DatabaseError if fewer than two are left.
        """
        if len(self.images) - len(names) < 2:
            raise DatabaseError(
                f"{self.source}: has fewer than two frames with shorter smears; allow longer ones"
            )
        self.aside |= {name: self.images.pop(name) for name in names}
        self.poses = {name: pose for name, pose in self.poses.items() if name not in names}

    def alone(self) -> list[str]:
        """Return the registered frames without those of rigs of several cameras, which share a pose."""
        registered = [name for name in self.times if name in self.images]
        return [name for name in registered if self.images[name].frame.num_data_ids() == 1]

    def smear_px(self, name: str) -> float:
        """Return the median length of a registered frame's smears at the points that it sees; 0 of none.

        A file that cannot be read has none, and its frame keeps its pose.
        """
        try:
            view = self.view(name)
        except ImageError:
            return 0.0
        pixels = view.project(self.world(self.observed_points(name)))
        lengths = np.linalg.norm(view.smears(pixels[np.isfinite(pixels).all(axis=1)])[0], axis=1)
        return float(np.median(lengths)) * view.grid.size[0] / view.camera.width if len(lengths) else 0.0

    def rounds(self) -> list[list[str]]:
        """Return the frames that the model lacks, those next to registered ones first."""
        missing = [name for name in self.times if name not in self.images]
        gaps = {name: ceil(min(self._apart(name, known) for known in self.images)) for name in missing}
        return [[name for name in missing if gaps[name] == gap] for gap in sorted({*gaps.values()})]

    def note(self, name: str, result: "RecoveredFrame | str") -> None:
        """Note a recovered frame, or why one is refused."""
        if isinstance(result, str):
            self.refused[name] = result
        else:
            self.recovered[name] = result

    def misplaced(self) -> list[str]:
        """Return the registered frames that see little of what others see, and do not fit.

        They are off the path of the others, or the points that they see lie far from their keypoints. Of a
        burst of RedKitchen's frames COLMAP registered one with 30 points, where others see 640, 2.5 degrees
        and 7.8 steps off, and neighbours were refused that do not agree with it. Of a rendered video it
        registered a sharp one with 205 points of 727, 3.9 degrees off: 14.7 standard deviations, where no
        other frame of these sequences has more than 5. At the beginning of another one, where the path says
        little, three were 1.0 to 2.0 degrees off, with residuals of 2.4 to 4.8 times the median frame's.
        """
        seen = {name: len(observed(self.model, image)) for name, image in self.images.items()}
        weak = [name for name, count in seen.items() if count < WEAK_SHARE * median(seen.values())]
        off = {name: self._residual_px(name) for name in self.images} if weak else {}
        most = MAX_RESIDUAL * max(LEAST_RESIDUAL_PX, median(off.values())) if weak else 0.0
        found = [name for name in weak if off[name] > most]
        weak, others = [name for name in weak if name not in found], self.poses.keys() - {*found}
        while weak:
            far = {name: self._departure(name, others - {name}) for name in weak}
            worst = max(far, key=lambda name: far[name])
            if far[worst] <= MAX_DEPARTURE:
                break
            weak.remove(worst)
            others.remove(worst)
            found.append(worst)
        return found

    def _residual_px(self, name: str) -> float:
        """Return how far a registered frame's keypoints are from what they show, median; 0 of none."""
        image = self.images[name]
        ids = observed(self.model, image)
        if not ids:
            return 0.0
        keypoints = from_colmap(np.array([image.points2D[keypoint].xy for keypoint in ids]))
        pose = self.poses[name]
        points = self.world(ids.values()) @ pose[:, :3].T + pose[:, 3]
        off = keypoints - projected(self.model.cameras[image.camera_id], points)
        return float(np.median(np.linalg.norm(off, axis=1)))

    def _departure(self, name: str, others: Collection[str]) -> float:
        """Return how far a registered frame is off the path of others, in standard deviations."""
        expected = self.expected(name, sorted(others)) if len(others) > 1 else None
        return 0.0 if expected is None else departure_sigmas(self.poses[name], expected)

    def try_frame(self, name: str) -> "RecoveredFrame | str":
        """Return a frame with its pose, or why it is refused."""
        try:
            return self._recover_one(name)
        except ImageError as error:
            return str(error)
        except (ValueError, ArithmeticError, cv2.error):  # of numbers that fit no motion
            return NO_FIT

    def near(self, name: str) -> list[str]:
        """Return the registered frames, the nearest in time first: itself, if it is one."""
        return sorted(self.images, key=lambda known: (self._apart(name, known), self.times[known]))

    def _apart(self, name: str, other: str) -> float:
        return abs(self.times[name] - self.times[other])

    def expected(self, name: str, others: Collection[str] | None = None) -> Expected | None:
        """Predict a frame by the path of the others, by default all; None where fewer than two are near."""
        others = self.poses if others is None else others
        times, poses = [self.times[other] for other in others], [self.poses[other] for other in others]
        return CameraPath(np.array(times, float), np.stack(poses), NEAR_FRAMES).expected(self.times[name])

    def view(self, name: str, pose: Array | None = None) -> View:
        """Return a frame in the working size at a pose (3, 4), by default its own."""
        return replace(self._read(name), pose=self.poses[name] if pose is None else pose)

    def _read_frame(self, name: str) -> View:
        """Read a frame, with its own camera, or that of the nearest registered one."""
        picture = read_picture(self.folder / name, as_stored=True)
        width, height = picture.size
        image = self.images.get(name) or self.aside.get(name) or self.images[self.near(name)[0]]
        camera = self.model.cameras[image.camera_id]
        if (camera.width, camera.height) != (width, height):
            raise ImageError(
                f"{self.folder / name}: has {width}x{height} pixels, but the model's camera "
                f"{camera.width}x{camera.height}; name a folder of frames with that size"
            )
        light = linear_light(picture.levels())
        view = View(image=light, grid=self.network.predict(picture.pixels), camera=camera, pose=np.eye(3, 4))
        return view.scaled(min(1.0, WORK_SIDE / max(width, height)))

    def _recover_one(self, name: str) -> RecoveredFrame:
        """Return a frame with its pose; ImageError with the reason if there is none."""
        expected, near = self.expected(name), self.near(name)[:MATCHED_NEIGHBOURS]
        if expected is None:
            raise ImageError(TOO_FAR)
        view = self.view(name, expected.pose)
        neighbours = [self.view(neighbour) for neighbour in near]
        seen = [self.observed_points(neighbour) for neighbour in near]
        ids = np.array(sorted(frozenset().union(*seen)))
        masks = [np.isin(ids, list(points)) for points in seen]
        world = self.world(ids)
        found = find_pose(view, neighbours, world, masks, expected.motion)
        if found is None or refusal(found, expected) == TOO_FEW:
            pose = searched_pose(view, neighbours[0], world[masks[0]])
            if pose is not None:
                view = replace(view, pose=pose)
                found = find_pose(view, neighbours, world, masks, expected.motion)
        if found is None or (reason := refusal(found, expected)):
            raise ImageError(TOO_FEW if found is None else reason)
        # recovered frames, which erred with this one, would be counted twice: of runs of 6 in RedKitchen
        # regions of 90 % held 0.48 with them, and 0.69 without
        known = expected if len(self.poses) == len(self.images) else self.expected(name, self.images)
        pose, covariance = weighted_mean(found, known)
        scale = view.grid.size[0] / view.camera.width
        return RecoveredFrame(
            pose=pose,
            covariance=covariance,
            motion=found.motion,
            motion_covariance=found.motion_covariance,
            points=ids[found.numbers],
            pixels=to_resized(found.pixels, scale),
            residual_px=found.residual_px * scale,
        )

    def observed_points(self, name: str) -> frozenset[int]:
        """Return the ids of the points that a registered frame sees, or the nearest one to a frame."""
        return self._observed(self.near(name)[0])

    def _read_observed(self, name: str) -> frozenset[int]:
        return frozenset(observed(self.model, self.images[name]).values())

    def world(self, ids: Iterable[int]) -> Array:
        """Return points (N, 3) by their ids."""
        return np.array([self.model.points3D[int(number)].xyz for number in ids]).reshape(-1, 3)


def refusal(found: BlurredPose, expected: Expected) -> str:
    """Return why a pose is not believed, empty if it is."""
    if len(found.numbers) < max(MIN_POINTS, MIN_FOUND * found.tried):
        return TOO_FEW
    if found.residual_px > MAX_RESIDUAL_PX:
        return "its points do not lie where its pose projects them"
    if departure_sigmas(found.pose, expected) > MAX_DEPARTURE:
        return "its pose is too far from its neighbours' path"
    smears = found.smear_motion[:3]
    corrected = float(np.linalg.norm(found.motion[:3] - smears) / (np.linalg.norm(smears) + TINY))
    unsure = len(found.numbers) < SURE_FOUND * found.tried
    if unsure and corrected > MAX_CORRECTION and np.linalg.norm(smears) > expected.rotation_rad:
        return "its smears differ from the blur that its neighbours show"
    return ""


def departure_sigmas(pose: Array, expected: Expected) -> float:
    """Return how far a pose is off the expected one, in rotation or position, in standard deviations."""
    change = relative_motion(pose, expected.pose)
    turned = float(np.linalg.norm(change[:3])) / expected.rotation_rad
    moved = float(np.linalg.norm(change[3:])) / expected.position
    return max(turned, moved) / MEDIAN_OF_THREE


def weighted_mean(found: BlurredPose, expected: Expected | None) -> tuple[Array, Array]:
    """Return the mean of the poses found and expected, weighted without the bend, and its covariance."""
    matches = np.asarray(np.linalg.pinv(found.information * INDEPENDENT_SHARE, hermitian=True), float)
    turned, moved, bent = (np.linalg.norm(part) for part in np.split(found.motion, 3))
    shares = [np.hypot(KERNEL_ERROR, error * bent / (turned + TINY)) for error in (BEND_ERROR, 0.0)]
    shared = [np.repeat([np.hypot(share * turned, MIN_ERROR_RAD), share * moved], 3) ** 2 for share in shares]
    own, even = (matches + np.diag(squared) for squared in shared)
    if expected is None or not np.isfinite([expected.rotation_rad, expected.position]).all():
        return found.pose, own
    prior = np.diag(np.repeat([expected.rotation_rad, expected.position], 3) * SPLINE_TAIL) ** 2
    gain = even @ np.linalg.inv(even + prior)
    pose, kept = changed(found.pose, gain @ relative_motion(found.pose, expected.pose)), np.eye(6) - gain
    return pose, kept @ own @ kept.T + gain @ prior @ gain.T
