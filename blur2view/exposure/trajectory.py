"""A camera's path through the poses of frames, and its motion during their exposures, which lie on it.

A reconstruction of a video's frames knows the depth of every feature, so that its smear is linear in the
camera's rotation and translation; and every exposure is the same fraction of the frame interval. So smears
measure that fraction, and where a frame's rotation departs from the path. Positions are those of the path,
as smears err by more than a short exposure's parallax. Measured by ``python -m tools.evaluation.placed``.

Poses are cam_from_world (3, 4). The *change* (6,) from one pose to another is a rotation vector and a
translation, X2 = R X1 + t of points in the two cameras.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from blur2view.arrays import TINY, Array
from blur2view.geometry.pose import rotation_flow, rotation_matrix, rotation_vector
from blur2view.two_view.least_squares import reweighted_motion

KNOTS = 4  # frames on each side through which the spline goes
MAX_EXTRAPOLATION = 0.5  # frames beyond the last one up to which the cubic is used, and a line farther
TRIALS = 40  # frames, the nearest, that are predicted to measure the spline's error
MEDIAN_OF_THREE = 1.54  # median length of a vector of three normal components of unit variance
MAX_INDEPENDENT = 4  # smears; with more, rotations are called surer than tools.evaluation.placed shows them
MIN_SMEARS = 8  # of a frame whose own rotation is estimated
STEPS = 15  # of reweighting: from a trajectory that is far off it takes ten
PATH_REACH = 3.5  # frames to the knots of the path
EXTRAPOLATED_SIGMA = 3.0  # factor of the standard deviation where one side has no frame
SIGMAS: Array = np.geomspace(
    0.03, 64, 29
)  # of a path's rotations, over their size: the values that are tried
DEGREES_OF_FREEDOM = 4  # of Student's t: some frames are outliers
FIRST_FRACTION, ROUNDS, MAX_FRACTION = 0.5, 5, 1.0  # of exposure over frame interval
MIN_LENGTH_RATIO = 0.1  # of smears to those of a given exposure: shorter ones, of sharp frames, say nothing


def relative_motion(first: Array, second: Array) -> Array:
    """Return the change (6,) that leads from one pose (3, 4) to another."""
    R = second[:, :3] @ first[:, :3].T
    return np.append(rotation_vector(R), second[:, 3] - R @ first[:, 3])


def changed(pose: Array, change: Array) -> Array:
    """Return a pose (3, 4) after a change (6,)."""
    R = rotation_matrix(change[:3])
    return np.column_stack([R @ pose[:, :3], R @ pose[:, 3] + change[3:]])


class Expected(NamedTuple):
    """The pose that a path predicts for a frame, and its errors."""

    pose: Array  # (3, 4)
    rotation_rad: float  # standard deviation about each axis
    position: float  # standard deviation along each axis, units of the model
    motion: Array  # (6,) change from half a frame before to half a frame after


class CameraPath:
    """A spline through poses (N, 3, 4) of frames at times (N,), in frames, no farther than ``reach`` away."""

    def __init__(self, times: Array, poses: Array, reach: float) -> None:
        order = np.argsort(times)
        self.times, self.poses, self.reach = np.asarray(times, float)[order], np.asarray(poses)[order], reach

    def at(self, time: float) -> Array | None:
        """Return the pose at a time by a cubic, by a line beyond the last frame; None of fewer than two."""
        near = np.abs(self.times - time) <= self.reach
        times, poses = self.times[near], self.poses[near]
        if len(times) < 2:
            return None
        split = int(np.searchsorted(times, time))
        knots = slice(max(0, split - KNOTS), split + KNOTS)
        if split in (0, len(times)) and np.abs(times - time).min() > MAX_EXTRAPOLATION:
            knots = slice(0, 2) if split == 0 else slice(len(times) - 2, len(times))
        times, poses = times[knots], poses[knots]
        middle = poses[np.argmin(np.abs(times - time))]
        turns = [rotation_vector(pose[:, :3] @ middle[:, :3].T) for pose in poses]
        centres = [-pose[:, :3].T @ pose[:, 3] for pose in poses]
        spline = make_interp_spline(times, np.column_stack([turns, centres]), k=min(3, len(times) - 1))
        turn, centre = np.split(spline(time), 2)
        R = rotation_matrix(turn) @ middle[:, :3]
        return np.column_stack([R, -R @ centre])

    def sides(self, time: float) -> tuple[bool, bool]:
        """Return whether there are frames within reach before a time, and after it."""
        steps = self.times - time
        before, after = (steps < 0) & (steps >= -self.reach), (steps > 0) & (steps <= self.reach)
        return bool(before.any()), bool(after.any())

    def ends(self, time: float, fraction: float) -> Array:
        """Return the changes (2, 6) from mid exposure to both ends of an exposure; NaN of no path."""
        middle, first, last = (self.at(time + share * fraction) for share in (0.0, -0.5, 0.5))
        if middle is None or first is None or last is None:
            return np.full((2, 6), np.nan)
        return np.stack([relative_motion(middle, first), relative_motion(middle, last)])

    def expected(self, time: float) -> Expected | None:
        """Return the pose at a time, and the errors of known frames on a path without their neighbours."""
        pose, first, last = (self.at(time + step) for step in (0.0, -0.5, 0.5))
        if pose is None or first is None or last is None:
            return None
        before, after = self.times[self.times < time], self.times[self.times > time]
        gap = (time - before[-1] if len(before) else np.inf), (after[0] - time if len(after) else np.inf)
        errors = []
        for index in np.argsort(np.abs(self.times - time), kind="stable")[:TRIALS]:
            known_time = self.times[index]
            outside_gap = (self.times <= known_time - gap[0]) | (self.times >= known_time + gap[1])
            path = CameraPath(self.times[outside_gap], self.poses[outside_gap], self.reach)
            pose_there = path.at(known_time) if path.sides(known_time) == self.sides(time) else None
            if pose_there is not None:
                change = relative_motion(self.poses[index], pose_there)
                errors.append((np.linalg.norm(change[:3]), np.linalg.norm(change[3:])))
        spread = np.median(errors, axis=0) / MEDIAN_OF_THREE if errors else np.full(2, np.inf)
        rotation_rad, position = map(float, np.maximum(spread, TINY))
        return Expected(pose, rotation_rad, position, relative_motion(first, last))


@dataclass(frozen=True, kw_only=True, eq=False)
class ExposedFrame:
    """A frame's smears at features of known depth, and its time in frames."""

    time: float
    rays: Array  # (N, 2): x/z, y/z of the features at mid exposure
    displacement: Array  # (N, 2): their smears, open to close, in the same coordinates
    inverse_depth: Array  # (N,): one over the features' z

    def flow(self, motion: Array) -> Array:
        """Return the smears (N, 2) of a small motion (6,), rotation vector and translation of points."""
        turned = np.tensordot(motion[:3], rotation_flow(self.rays), (0, 1)).T
        return np.asarray(turned + (motion[3:5] - self.rays * motion[5]) * self.inverse_depth[:, None])

    def length_ratio(self, motion: Array) -> float:
        """Return the median ratio of smears to those of a motion, negative if they run against it; or NaN."""
        if len(self.rays) < MIN_SMEARS:
            return float("nan")
        flow = self.flow(motion)
        return float(np.median((flow * self.displacement).sum(axis=1) / ((flow**2).sum(axis=1) + TINY)))


def turning(frame: ExposedFrame, motion: Array) -> tuple[float, float]:
    """Return the rotation of an exposure by its smears, radians, and its standard deviation; infinite of few.

    ``motion`` (6,) is that of the path over a frame interval, of which the exposure is as much as its smears
    are of that motion's.
    """
    ratio = abs(frame.length_ratio(motion))
    rotation, information, _ = _rotation(frame, min(ratio, MAX_FRACTION) * motion)
    angle = float(np.linalg.norm(rotation))
    if not information.any():
        return 0.0, float("inf")
    axis = rotation / (angle + TINY)
    return angle, float(np.sqrt(axis @ np.linalg.pinv(information, hermitian=True) @ axis))


def exposures(
    frames: Sequence[ExposedFrame], path: CameraPath, fraction: float | None = None
) -> tuple[Array, float, bool]:
    """Return the changes (N, 2, 6) from mid exposure to both ends of each exposure, by path and smears.

    Also the exposure over the frame interval (NaN if no frame shows it), and whether it was measured; if not,
    the camera shakes faster than the frames and it is a guess.
    """
    if fraction is not None:
        ends = _ends(frames, path, fraction)
        ratios = _length_ratios(frames, ends)
        if not len(ratios) or np.median(ratios) > MIN_LENGTH_RATIO:
            ends, _ = _placed(frames, path, fraction)
        return ends, fraction, True
    fraction = FIRST_FRACTION
    for _ in range(ROUNDS):
        ratios = _length_ratios(frames, _ends(frames, path, fraction))
        if not len(ratios):
            return np.full((len(frames), 2, 6), np.nan), float("nan"), True
        fraction = float(np.clip(fraction * np.median(ratios), 1e-3, MAX_FRACTION))
    ends, share = _placed(frames, path, fraction)
    if fraction < MAX_FRACTION or share > 0:
        return ends, fraction, True
    return _placed(frames, path, FIRST_FRACTION)[0], FIRST_FRACTION, False


def _ends(frames: Sequence[ExposedFrame], path: CameraPath, fraction: float) -> Array:
    """Return the changes (N, 2, 6) from mid exposures to their ends on the path, NaN where it is unknown."""
    return np.stack([path.ends(frame.time, fraction) for frame in frames])


def _length_ratios(frames: Sequence[ExposedFrame], ends: Array) -> Array:
    """Return the ratios of smears to those of exposures with these ends, of the frames that show one."""
    motions = ends[:, 1] - ends[:, 0]
    ratios = np.abs([frame.length_ratio(motion) for frame, motion in zip(frames, motions, strict=True)])
    return ratios[np.isfinite(ratios)]


def _placed(frames: Sequence[ExposedFrame], path: CameraPath, fraction: float) -> tuple[Array, float]:
    """Return the changes of `exposures`, and the median share, 0 to 1, of the path's rotations in them.

    Of each frame that the path reaches, with p the rotation of the path over the exposure, r that of the
    smears, L its information (3, 3) and v the variance of p, the rotation is

        (L + w I)^-1 (L r + w s p),    w = 1 / (a^2 v),    s = 1 - a^2,

    where a is the likeliest factor of the path's deviations (`_likeliest_sigma`), larger beyond the last
    frame: the farther the path errs, the less of its rotation is believed.
    """
    ends = _ends(frames, path, fraction)
    reached = np.flatnonzero(np.isfinite(ends).all(axis=(1, 2))).tolist()
    if not reached:
        return ends, 0.0
    motions = (ends[:, 1] - ends[:, 0])[reached]
    rotations = [_rotation(frames[k], motion) for k, motion in zip(reached, motions, strict=True)]
    r, L, senses = (np.array(values) for values in zip(*rotations, strict=True))
    p = senses[:, None] * motions[:, :3]
    one_sided = np.array([not all(path.sides(frames[k].time)) for k in reached])
    factors = np.where(one_sided, EXTRAPOLATED_SIGMA, 1.0)
    v = factors**2 * np.median((p**2).mean(axis=1))
    a = _likeliest_sigma(r - p, L, v)
    shares = np.clip(1 - (a * factors) ** 2, 0, 1)
    w = 1 / (a**2 * v + TINY)[:, None]
    right = (L @ r[..., None])[..., 0] + w * shares[:, None] * p
    turns = np.linalg.solve(L + w[..., None] * np.eye(3), right[..., None])[..., 0]
    for k, turn, sense, share in zip(reached, turns, senses, shares, strict=True):
        ends[k] = ends[k, ::sense]
        ends[k, :, :3] = share * ends[k, :, :3].mean(axis=0) + np.outer([-0.5, 0.5], turn)
    return ends, float(np.median(shares))


def _rotation(frame: ExposedFrame, motion: Array) -> tuple[Array, Array, int]:
    """Return the rotation (3,) by smears, its information (3, 3), and -1 if they run against the motion (6,).

    Its translation is that of the motion, in the sense of the smears.
    """
    sense = -1 if frame.length_ratio(motion) < 0 else 1
    motion = sense * motion
    if len(frame.rays) < MIN_SMEARS:
        return motion[:3], np.zeros((3, 3)), sense
    length = np.linalg.norm(frame.displacement, axis=1) + TINY
    rows = rotation_flow(frame.rays).transpose(1, 0, 2) / length
    moved = frame.displacement - frame.flow(np.append(np.zeros(3), motion[3:]))

    def scale(missed: Array) -> float:
        return max(float(np.median(missed)), 1e-6)

    turn, missed = reweighted_motion(rows, moved.T / length, steps=STEPS, scale=scale, start=motion[:3])
    weight = min(1.0, MAX_INDEPENDENT / len(length)) / (scale(missed) ** 2 + missed**2)
    return turn, np.einsum("idn,jdn,n->ij", rows, rows, weight), sense


def _likeliest_sigma(errors: Array, information: Array, variances: Array) -> float:
    """Return the likeliest of `SIGMAS`: the factor of a path's deviations (N,), by its errors (N, 3).

    A shake faster than the frames looks slow in their poses; only smears, of this information (N, 3, 3), show
    that it is fast.
    """
    has_smears = information.any(axis=(1, 2))
    d, C = errors[has_smears], np.linalg.pinv(information[has_smears], hermitian=True)
    log_likelihoods = []
    for factor in SIGMAS:
        covariance = C + np.eye(3) * variances[has_smears, None, None] * factor**2
        far = (d * np.linalg.solve(covariance, d[..., None])[..., 0]).sum(axis=1)
        log_volume = np.linalg.slogdet(covariance)[1]
        likelihood = log_volume + (DEGREES_OF_FREEDOM + 3) * np.log1p(far / DEGREES_OF_FREEDOM)
        log_likelihoods.append(-0.5 * likelihood.sum())
    return float(SIGMAS[int(np.argmax(log_likelihoods))])  # the first where no frame has smears
