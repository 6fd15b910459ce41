"""The frames of a video in series, and which end of an exposure came first: frames before and after decide.

Each match with a neighbour compares its displacement with the smear at its place; longer ones count for more.
Where noise decided the sign of a translation, time reversal alone gives no right answer: so all four
combinations of both signs are candidates. On 66 frames of RedKitchen with their intrinsics the pose's
rotation then agreed in sign with the recorder's in 64 of 64 frames, with time reversal alone in 45.
"""

import os
import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import accumulate, groupby, pairwise
from pathlib import Path
from posixpath import dirname
from typing import Generic, NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, AnyArray, Array
from blur2view.camera import Camera
from blur2view.errors import ImageError
from blur2view.exposure.views import ExposureViews, other_translation, share_in_front, views_of
from blur2view.geometry.pose import decompose_essential
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.geometry.two_view_geometry import TimeDirection
from blur2view.images.inputs import photographs_in
from blur2view.images.pixels import as_photograph, as_rgb, from_resized
from blur2view.images.video import read_video
from blur2view.networks.model_file import one_thread
from blur2view.networks.smear_network import SmearNetwork, SmearReader
from blur2view.pipeline import Estimate, estimate
from blur2view.smears.matches import SelectOptions
from blur2view.two_view.estimate import EstimatorOptions

MATCHED_SIDE_PX = 640  # pixels: pictures are reduced to this side, blurred ones show no more in larger ones
MAX_FEATURES = 4000  # with 1000 the rotation of 94 % of RedKitchen's frames came out right instead of 100 %
CONTRAST_THRESHOLD = 0.01  # SIFT's: blurred pictures have little
RATIO = 0.8  # best over second best distance (Lowe 2004)
MAX_F_ERROR_PX = 2.0  # of the fundamental matrix that verifies matches, at `MATCHED_SIDE_PX`
PAIRS_KEPT = 2  # matched ones: each is asked for by both frames
MIN_VERIFIED = 12  # that are verified; fewer may be chance
MAX_DISTANCE = 0.04  # from a match to the nearest smear that is used, of the longer side
MIN_VOTES = 8  # matches near smears; fewer do not decide
# Errors of smears are correlated, so hundreds of matches are worth few independent ones. With 30 nothing
# below a mean cosine of 0.23 is called known; of 64 frames of RedKitchen, intrinsics unknown and the time
# reversal alone decided, four were wrong, with mean cosines of 0.07 to 0.19.
INDEPENDENT_SMEARS = 30
MIN_CONFIDENCE = 0.8  # from which the direction is called known: right nine times in ten
MAX_EXPOSURES_APART = 25.0  # exposures from frame to frame (RedKitchen: 1 to 6); then motion may have changed
ROTATION_WEIGHT = 0.3  # of the rotation's cosine beside the smears'; 0: 83 % of the rotations right, 1: 95 %
CHEIRALITY_WEIGHT = 0.1  # of the share of points in front of both cameras: decides where orders are equal
ESSENTIAL_PX = 1.0  # maximum error of the essential matrix between neighbours
GAP_FRAMES = 100  # time step, in frame intervals, between recordings: too long for any conclusion
Features = tuple[Array, NDArray[np.uint8]]  # points (N, 2), descriptors (N, 128): 0.6 MB of 4000
Matches = tuple[Array, Array]  # pixels (M, 2) in two photographs
NO_POINTS = np.zeros((0, 2))
NO_FEATURES: Features = (NO_POINTS, np.zeros((0, 128), np.uint8))
Frame = TypeVar("Frame", bound=Hashable)


class PictureMotion(NamedTuple):
    """The motion of the picture about the time of a photograph, by matches with its neighbours."""

    points: Array  # (M, 2) pixels of the photograph
    velocity: Array  # (M, 2) there, pixels per frame, forwards in time
    rotation: Array  # (3,) per frame and neighbour, summed, as in cam2_from_cam1; 0 if unknown


def extract_features(image: NDArray[np.float32]) -> Features:
    """Return SIFT features of a photograph (H, W, 3), RGB in [0, 1]: pixels and descriptors."""
    grey = np.asarray(np.rint(255 * cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)), np.uint8)
    scale = min(1.0, MATCHED_SIDE_PX / max(grey.shape))
    if scale < 1:
        grey = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    # without the last option OpenCV's features lie a quarter of a pixel off
    sift = cv2.SIFT.create(MAX_FEATURES, contrastThreshold=CONTRAST_THRESHOLD, enable_precise_upscale=True)
    keypoints, descriptors = sift.detectAndCompute(grey, None)
    if not keypoints:
        return NO_FEATURES
    points = from_resized(np.array([keypoint.pt for keypoint in keypoints]), scale)
    return points, np.asarray(descriptors, np.uint8)  # whole numbers, which OpenCV returns as floats


def match_features(features1: Features, features2: Features) -> Matches:
    """Match mutual nearest neighbours that pass the ratio test and follow one fundamental matrix."""
    points1, points2 = features1[0], features2[0]
    d1, d2 = (descriptors.astype(np.float32) for _, descriptors in (features1, features2))
    if min(len(points1), len(points2)) < MIN_VERIFIED:
        return NO_POINTS, NO_POINTS
    unit1, unit2 = (d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-6) for d in (d1, d2))
    similarity = unit1 @ unit2.T
    best, back = similarity.argmax(axis=1), similarity.argmax(axis=0)
    rows = np.arange(len(best))
    first = similarity[rows, best]  # of unit vectors, half of whose squared distance is 1 - similarity
    similarity[rows, best] = -np.inf
    clear = 1 - first < RATIO**2 * (1 - similarity.max(axis=1))
    chosen = np.flatnonzero(clear & (back[best] == rows))
    points1, points2, fits = points1[chosen], points2[best[chosen]], np.zeros(0, bool)
    if len(chosen) >= MIN_VERIFIED:
        bound = MAX_F_ERROR_PX * max(1.0, float(max(points1.max(), points2.max())) / MATCHED_SIDE_PX)
        with suppress(cv2.error):  # of a few pixels over and over, as noise may match (usac/estimator.cpp)
            inliers = cv2.findFundamentalMat(points1, points2, cv2.USAC_MAGSAC, bound, 0.999, 2000)[1]
            fits = np.zeros(0, bool) if inliers is None else inliers.ravel().astype(bool)
    return (points1[fits], points2[fits]) if fits.sum() >= MIN_VERIFIED else (NO_POINTS, NO_POINTS)


class Series(Generic[Frame]):
    """Frames in the order of time, of which each pair of neighbours is matched once.

    ``find_features`` gives the features of a frame, None if it cannot be read.
    """

    def __init__(self, find_features: Callable[[Frame], Features | None]) -> None:
        self._find_features, self._matched = find_features, dict[tuple[Frame, Frame], Matches]()

    @one_thread
    def around(self, frame: Frame, neighbours: Iterable[tuple[int, Frame]]) -> dict[int, Matches]:
        """Return the matches of a frame with its neighbours, by their steps in time, own pixels first."""
        found = dict[int, Matches]()
        for steps, other in neighbours:
            pair = (other, frame) if steps < 0 else (frame, other)
            if pair not in self._matched:
                first, second = map(self._find_features, pair)
                if first is None or second is None:
                    continue
                self._matched[pair] = match_features(first, second)
                for oldest in list(self._matched)[:-PAIRS_KEPT]:
                    del self._matched[oldest]
            earlier, later = self._matched[pair]
            found[steps] = (later, earlier) if steps < 0 else (earlier, later)
        return found


def picture_motion(matches: Mapping[int, Matches], camera: Camera | None = None) -> PictureMotion:
    """Return the motion by matches with the photographs before (-1) and after (1), own pixels first."""
    points = np.concatenate([NO_POINTS, *(here for here, _ in matches.values())])
    velocity = [NO_POINTS, *((there - here) / steps for steps, (here, there) in matches.items())]
    rotation = np.zeros(3)
    if camera is not None and camera.known:
        for steps, both in matches.items():
            rotation += rotation_between(camera, *both) / steps
    return PictureMotion(points, np.concatenate(velocity), rotation)


def rotation_between(camera: Camera, points1: Array, points2: Array) -> Array:
    """Return the smaller rotation vector, cam2_from_cam1, by matches (M, 2); 0 of too few."""
    rays = np.stack([camera.rays(points1), camera.rays(points2)])
    rays = rays[:, np.isfinite(rays).all(axis=(0, 2))]
    if rays.shape[1] < MIN_VOTES:
        return np.zeros(3)
    bound = ESSENTIAL_PX / camera.focal_px
    E = cv2.findEssentialMat(rays[0], rays[1], np.eye(3), cv2.USAC_MAGSAC, 0.999, bound)[0]
    if E is None or E.shape != (3, 3):
        return np.zeros(3)
    return decompose_essential(np.asarray(E, float))[0].rotation_vector


def time_agreement(views: ExposureViews, motion: PictureMotion) -> float:
    """Return the mean cosine between smears and the picture's motion, weighted by its length; or 0."""
    inliers = views.geometry.inlier_mask
    if not inliers.any() or not len(motion.points):
        return 0.0
    start, close = views.points_open[inliers], views.points_close[inliers]
    from scipy.spatial import cKDTree  # slow to import, and needed only where neighbours are compared

    distance, index = cKDTree((start + close) / 2).query(motion.points)
    smear, velocity = (close - start)[index], motion.velocity
    voting = velocity.any(axis=1) & smear.any(axis=1) & (distance < MAX_DISTANCE * max(views.size))
    smear, velocity = smear[voting], velocity[voting]
    length, smeared = np.linalg.norm(velocity, axis=1), np.linalg.norm(smear, axis=1)
    if voting.sum() < MIN_VOTES or np.median(length / smeared) > MAX_EXPOSURES_APART:
        return 0.0
    return float(((smear * velocity).sum(axis=1) / smeared).sum() / length.sum())


def directed(
    views: ExposureViews, motion: PictureMotion, candidates: Sequence[ExposureViews] = ()
) -> ExposureViews:
    """Return the candidate that agrees best; by default the four signs of time and translation."""
    if time_agreement(views, motion) == 0:
        return replace(views, time=TimeDirection())
    if not candidates:
        twins = [views, other_translation(views)]
        candidates = [flip for twin in twins if twin is not None for flip in (twin, twin.reversed())]

    def score(candidate: ExposureViews) -> float:
        pose = candidate.geometry.cam2_from_cam1
        turn = np.zeros(3) if pose is None else pose.rotation_vector
        lengths = max(float(np.linalg.norm(turn) * np.linalg.norm(motion.rotation)), TINY)
        cosine = float(turn @ motion.rotation) / lengths
        agreement, in_front = time_agreement(candidate, motion), share_in_front(candidate)
        return agreement + ROTATION_WEIGHT * cosine + CHEIRALITY_WEIGHT * in_front

    best = max(candidates, key=score)
    from scipy.special import ndtr

    # P(right) - P(wrong), by the mean cosine of `INDEPENDENT_SMEARS`
    agreement = max(time_agreement(best, motion), 0.0)
    confidence = float(2 * ndtr(agreement * np.sqrt(INDEPENDENT_SMEARS)) - 1)
    known = confidence >= MIN_CONFIDENCE
    return replace(best, time=TimeDirection(known=known, confidence=confidence if known else 0.0))


def in_time(estimated: Estimate, matches: Mapping[int, Matches]) -> Estimate:
    """Return an estimate in the likelier direction of time, and its certainty, by `picture_motion`."""
    views, candidates = views_of("frame", replace(estimated, shutter=None)), list[ExposureViews]()
    if estimated.shutter is not None:  # another motion in the other order in time, or none
        candidates = [views] if estimated.geometry.backward is None else [views, views.reversed()]
    views = directed(views, picture_motion(matches, estimated.camera), candidates)
    return replace(estimated, geometry=views.geometry, time=views.time)


def frame_names(folder: str | os.PathLike[str]) -> list[str]:
    """Return the frames of a folder as COLMAP names them, in order; ImageError if there are none."""
    if not os.path.isdir(folder):
        raise ImageError(f"{folder}: no such folder; name the folder of the frames")
    return photographs_in(Path(folder)).readable().names()


def frame_times(names: Sequence[str]) -> list[float]:
    """Return the times of frames in order, in frame intervals: the median step of the numbers in their names.

    Numbers under one stem are times, in any step. Names that differ in more than their number follow one
    another in even steps. Between folders, and where numbers fall, lie `GAP_FRAMES` intervals.
    """
    steps: list[float] = []
    for _, folder in groupby(names, dirname):
        numbered = [split_number(name) for name in folder]
        own = [second - first for (_, first), (_, second) in pairwise(numbered)]
        rising = sorted(step for step in own if step > 0)
        interval = rising[(len(rising) - 1) // 2] if rising else 1
        if len({text for text, _ in numbered}) > 1:
            own = [interval] * len(own)
        steps += [GAP_FRAMES, *(step / interval if step > 0 else GAP_FRAMES for step in own)]
    return list(accumulate(steps))


def split_number(name: str) -> tuple[str, int]:
    """Split a file's name at its last number: the text around it, and the number (0 if there is none)."""
    parts = re.fullmatch(r"(.*?)(\d+)([^\d/]*(?:\.[A-Za-z]\w*)?)", name, re.DOTALL)  # .jp2 counts nothing
    if parts is None:
        return name, 0
    before, digits, after = parts.groups()
    return f"{before}\0{after}", int(digits)


def estimate_frames(
    frames: Iterable[AnyArray] | str | os.PathLike[str],
    *,
    timestamps_s: Iterable[float] | None = None,
    network: SmearReader | None = None,
    select: SelectOptions | None = None,
    options: EstimatorOptions | None = None,
    camera: Camera | None = None,
    shutter: RollingShutter | None = None,
) -> Iterator[Estimate]:
    """Return an iterator over estimates of a video's frames, each in the right direction of time.

    Each is what :func:`estimate` returns, and comes when the next frame is there: both neighbours decide the
    direction (``time``).

    Parameters
    ----------
    frames : iterable of ndarray of shape (H, W, 3) or (H, W), or path
        Pictures of one size in the order of time, or a video's file.
    timestamps_s : iterable of float, optional
        Their times in seconds, for example of `timestamps_of`.
    network, select, options, camera, shutter : optional
        Those of `estimate`, the same for all frames.

    Returns
    -------
    iterator of Estimate
        One of each frame, in order.

    Raises
    ------
    ValueError
        If ``frames`` is one photograph, sizes differ, or there are fewer times than frames; and all errors of
        `estimate`.

    Examples
    --------
    Rates of a robot's camera as its gyroscope shows them, for ROS's ``sensor_msgs/Imu``::

        paths = sorted(Path("mav0/cam0/data").glob("*.png"))
        stamps = blur2view.timestamps_of(paths)  # from the names
        images, camera = map(blur2view.read_image, paths), blur2view.Camera.from_focal(458.0, (752, 480))
        for result in blur2view.estimate_frames(images, timestamps_s=stamps, camera=camera):
            rate = result.angular_velocity(0.02)
            if rate is not None and result.time.known:  # it moved, shows a pose, and its sign is known
                publish(result.timestamp_s, rate.of_gyroscope.mean, rate.of_gyroscope.covariance)
    """
    estimate_one = partial(
        estimate,
        network=network or SmearNetwork(),
        select=select,
        options=options,
        camera=camera,
        shutter=shutter,
    )
    times = None if timestamps_s is None else iter(timestamps_s)
    return _in_series(map(as_photograph, _opened_frames(frames)), times, estimate_one)


def _opened_frames(frames: object) -> Iterable[AnyArray]:
    """Return the frames of a video, which may be its file; ValueError of anything else."""
    if isinstance(frames, str | os.PathLike):
        if os.path.isdir(frames):
            raise ValueError(f"{frames}: is a folder; pass map(blur2view.read_image, paths of its frames)")
        return read_video(frames)
    if isinstance(frames, np.ndarray) and frames.ndim < 4 or not isinstance(frames, Iterable):
        raise ValueError(
            f"expected the frames of a video, got {type(frames)}; for one photograph call estimate(image)"
        )
    return frames


def _in_series(
    frames: Iterable[AnyArray], times: Iterator[float] | None, estimate_one: Callable[[AnyArray], Estimate]
) -> Iterator[Estimate]:
    """Yield the estimate of each frame when the next one is there."""
    last: Estimate | None = None
    features = dict[int, Features]()  # of two frames, by their numbers
    series = Series(features.get)
    for number, frame in enumerate(frames):
        current = estimate_one(frame)
        if times is not None:
            if (time := next(times, None)) is None:
                raise ValueError("there are fewer timestamps than frames")
            if not np.isfinite(time):
                raise ValueError(f"timestamps_s must be finite seconds, got {time} for frame {number}")
            current = replace(current, timestamp_s=float(time))
        features[number] = extract_features(as_rgb(frame))
        if last is not None:
            if current.grid.size != last.grid.size:
                raise ValueError(
                    f"frame {number} has {current.grid.size} pixels, but the frames before have "
                    f"{last.grid.size}"
                )
            before = [(-1, number - 2)] if number > 1 else []
            yield in_time(last, series.around(number - 1, [*before, (1, number)]))
            features.pop(number - 2, None)
        last = current
    if last is not None:
        yield in_time(last, series.around(number, [(-1, number - 1)] if number else []))
