"""A camera's path through the poses of frames, and its motion during exposures whose place on it is known.

Where a reconstruction holds a video's frames, every feature's depth is known, which makes its smear linear in
the camera's rotation and translation; and an exposure is the same fraction of the way from frame to frame in
all of them. So smears measure that fraction, and where a frame's rotation departs from the path. Both are
weighed; positions are those of the path alone, as smears err by more than a short exposure's parallax.
``python -m tools.evaluation.placed`` measures what comes of it.

Poses are cam_from_world (3, 4); a *change* (6,) from one to another is a rotation vector and a translation of
points in the first camera.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from blur2view.arrays import TINY, Array
from blur2view.geometry.pose import rotation_flow, rotation_matrix, rotation_vector
from blur2view.two_view.least_squares import reweighted_motion

KNOTS = 4  # frames on each side through which the spline goes
MOST_BEYOND = 0.5  # frames beyond the last to which the cubic goes, and a line farther
TRIALS = 40  # frames, the nearest, that say how far off the spline is
MEDIAN_OF_THREE = 1.54  # median length of a vector of three standard deviations of one
MOST_INDEPENDENT = 4  # at most: with more, smears are called surer than tools.evaluation.placed shows them
MIN_SMEARS = 8  # smears; with fewer a frame's own rotation is not estimated
STEPS = 15  # of reweighting: from a trajectory that is far off it takes ten
PATH_REACH = 3.5  # frames to the knots of the path
BEYOND = 3.0  # times less sure where one side has no frame
FACTORS: Array = np.geomspace(0.03, 64, 29)  # standard deviation of a trajectory's rotations, of their size
FREEDOM = 4  # degrees, of Student's t: some frames are outliers
FIRST_GUESS, ROUNDS, LONGEST = 0.5, 5, 1.0  # of exposure over frame interval
LEAST_SHARE = 0.1  # of the length that a given exposure has: shorter smears measure nothing
BIAS = 0.1  # by which smears of a photograph may all be too long or too short, of their length


def change_of(first: Array, second: Array) -> Array:
    """Return the change (6,) that leads from one pose (3, 4) to another."""
    R = second[:, :3] @ first[:, :3].T
    return np.append(rotation_vector(R), second[:, 3] - R @ first[:, 3])


def changed(pose: Array, change: Array) -> Array:
    """Return a pose (3, 4) after a change (6,)."""
    R = rotation_matrix(change[:3])
    return np.column_stack([R @ pose[:, :3], R @ pose[:, 3] + change[3:]])


class Expected(NamedTuple):
    """Where a path expects a frame: a pose (3, 4), how it errs, and the change of a frame about it."""

    pose: Array
    rotation_rad: float  # standard deviation of each of three
    position: float  # the same, units of the model
    motion: Array  # (6,)


class CameraPath:
    """Poses (N, 3, 4) of frames at times (N,), in frames, and a spline through those within ``reach``."""

    def __init__(self, times: Array, poses: Array, reach: float) -> None:
        order = np.argsort(times)
        self.times, self.poses, self.reach = np.asarray(times, float)[order], np.asarray(poses)[order], reach

    def at(self, time: float, used: NDArray[np.bool_] | None = None) -> Array | None:
        """Return the pose at a time by a cubic, beyond all a line, through frames ``used`` (N,), or None."""
        known: NDArray[np.bool_] = np.abs(self.times - time) <= self.reach
        if used is not None:
            known &= used
        times, poses = self.times[known], self.poses[known]
        if len(times) < 2:
            return None
        split = int(np.searchsorted(times, time))
        near = slice(max(0, split - KNOTS), split + KNOTS)
        if split in (0, len(times)) and np.abs(times - time).min() > MOST_BEYOND:
            near = slice(0, 2) if split == 0 else slice(len(times) - 2, len(times))
        times, poses = times[near], poses[near]
        middle = poses[np.argmin(np.abs(times - time))]
        turns = [rotation_vector(pose[:, :3] @ middle[:, :3].T) for pose in poses]
        centres = [-pose[:, :3].T @ pose[:, 3] for pose in poses]
        spline = make_interp_spline(times, np.column_stack([turns, centres]), k=min(3, len(times) - 1))
        place = spline(time)
        R = rotation_matrix(place[:3]) @ middle[:, :3]
        return np.column_stack([R, -R @ place[3:]])

    def sides(self, time: float, used: NDArray[np.bool_] | None = None) -> tuple[bool, bool]:
        """Return whether there are frames within reach before a time, and after it."""
        steps = (self.times if used is None else self.times[used]) - time
        before, after = (steps < 0) & (steps >= -self.reach), (steps > 0) & (steps <= self.reach)
        return bool(before.any()), bool(after.any())

    def expected(self, time: float) -> Expected | None:
        """Return where the path expects a frame, and how far known frames are off a path without them."""
        pose, first, last = (self.at(time + step) for step in (0.0, -0.5, 0.5))
        if pose is None or first is None or last is None:
            return None
        before, after = self.times[self.times < time], self.times[self.times > time]
        gap = (time - before[-1] if len(before) else np.inf), (after[0] - time if len(after) else np.inf)
        errors = []
        for index in np.argsort(np.abs(self.times - time), kind="stable")[:TRIALS]:
            there = self.times[index]
            others = (self.times <= there - gap[0]) | (self.times >= there + gap[1])
            found = self.at(there, others) if self.sides(there, others) == self.sides(time) else None
            if found is not None:
                change = change_of(self.poses[index], found)
                errors.append((np.linalg.norm(change[:3]), np.linalg.norm(change[3:])))
        spread = np.median(errors, axis=0) / MEDIAN_OF_THREE if errors else np.full(2, np.inf)
        turn, move = map(float, np.maximum(spread, TINY))
        return Expected(pose, turn, move, change_of(first, last))


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

    def share(self, motion: Array) -> float:
        """Return smears over those of a motion, a median; negative if time is reversed; NaN if unknown."""
        if len(self.rays) < MIN_SMEARS:
            return float("nan")
        flow = self.flow(motion)
        return float(np.median((flow * self.displacement).sum(axis=1) / ((flow**2).sum(axis=1) + TINY)))


def ends_on(path: CameraPath, frames: Sequence[ExposedFrame], fraction: float) -> Array:
    """Return the changes (N, 2, 6) from mid exposure to both ends, NaN where the path has no neighbour."""
    found = np.full((len(frames), 2, 6), np.nan)
    for k, frame in enumerate(frames):
        middle, *ends = (path.at(frame.time + share * fraction) for share in (0.0, -0.5, 0.5))
        for end, pose in enumerate(ends):
            if middle is not None and pose is not None:
                found[k, end] = change_of(middle, pose)
    return found


def motions_between(ends: Array) -> Array:
    """Return the changes (N, 6) from first to last of `ends_on`, NaN where unknown."""
    found = np.full((len(ends), 6), np.nan)
    for frame in np.flatnonzero(np.isfinite(ends).all(axis=(1, 2))):
        first, last = (changed(np.eye(3, 4), end) for end in ends[frame])
        found[frame] = change_of(first, last)
    return found


def exposures(
    frames: Sequence[ExposedFrame], path: CameraPath, fraction: float | None = None
) -> tuple[Array, float, bool]:
    """Return the changes (N, 2, 6) from mid exposure to both ends of exposures, by path and smears.

    Then the exposure over the frame interval, as given or that for which smears and path agree, NaN if no
    frame shows it; and whether that is more than a guess, as of a camera that shakes faster than frames.
    """
    if fraction is not None:
        return _placed(_of_known_exposure(frames, path, fraction), path, fraction)[0], fraction, True
    fraction = FIRST_GUESS
    for _ in range(ROUNDS):
        shares = _shares(frames, path, fraction)
        if not len(shares):
            return np.full((len(frames), 2, 6), np.nan), float("nan"), True
        fraction = float(np.clip(fraction * np.median(shares), 1e-3, LONGEST))
    ends, share = _placed(frames, path, fraction)
    if fraction < LONGEST or share > 0:
        return ends, fraction, True
    return _placed(frames, path, FIRST_GUESS)[0], FIRST_GUESS, False


def _of_known_exposure(
    frames: Sequence[ExposedFrame], path: CameraPath, fraction: float
) -> Sequence[ExposedFrame]:
    """Return frames with smears as long as a known exposure's, as far as these show it; or without any."""
    shares = _shares(frames, path, fraction)
    if not len(shares):
        return frames
    logs, none = np.log(shares + TINY), np.zeros((0, 2))
    share = float(np.median(logs))
    if share <= np.log(LEAST_SHARE):
        return [replace(frame, rays=none, displacement=none, inverse_depth=none[:, 0]) for frame in frames]
    variance = (1.5 * float(np.median(np.abs(logs - share)))) ** 2 / len(shares)
    scale = np.exp(-share * BIAS**2 / (BIAS**2 + variance))
    return [replace(frame, displacement=scale * frame.displacement) for frame in frames]


def _shares(frames: Sequence[ExposedFrame], path: CameraPath, fraction: float) -> Array:
    """Return how long smears are, over those of an exposure on the path, of the frames that show it."""
    motions = motions_between(ends_on(path, frames, fraction))
    found = np.abs([frame.share(motion) for frame, motion in zip(frames, motions, strict=True)])
    return found[np.isfinite(found)]


def _placed(frames: Sequence[ExposedFrame], path: CameraPath, fraction: float) -> tuple[Array, float]:
    """Return the ends of `exposures`, and the median share, 0 to 1, of the path's rotations to expect."""
    ends = ends_on(path, frames, fraction)
    motions = motions_between(ends)
    doubts = np.array([1.0 if all(path.sides(frame.time)) else BEYOND for frame in frames])
    turned = motions[np.isfinite(motions[:, 0]), :3]
    spreads = doubts * (np.sqrt(np.median((turned**2).mean(axis=1))) if len(turned) else 1.0)
    doubt = _doubt(frames, motions, spreads)
    spreads, shares = doubt * spreads, np.clip(1 - (doubt * doubts) ** 2, 0, 1)
    motions[:, :3] *= shares[:, None]
    for frame, own, motion, spread, share in zip(frames, ends, motions, spreads, shares, strict=True):
        turn, _, sense = _turn(frame, motion, 1 / (spread + TINY) ** 2)
        own[:] = own[::sense]
        own[:, :3] = share * own[:, :3].mean(axis=0) + np.outer([-0.5, 0.5], turn)
    known = shares[np.isfinite(motions[:, 0])]
    return ends, float(np.median(known)) if len(known) else 0.0


def _turn(frame: ExposedFrame, motion: Array, precision: float) -> tuple[Array, Array, int]:
    """Return a rotation (3,) by smears and a motion (6,), their information (3, 3), -1 if they run back."""
    sense = -1 if frame.share(motion) < 0 else 1
    motion = sense * motion
    if len(frame.rays) < MIN_SMEARS or not np.isfinite(motion).all():
        return motion[:3], np.zeros((3, 3)), sense
    length = np.linalg.norm(frame.displacement, axis=1) + TINY
    share = min(1.0, MOST_INDEPENDENT / len(length))
    rows = rotation_flow(frame.rays).transpose(1, 0, 2) / length
    moved = frame.displacement - frame.flow(np.append(np.zeros(3), motion[3:]))

    def scale(missed: Array) -> float:
        return max(float(np.median(missed)), 1e-6)

    prior = motion[:3], np.full(3, precision / share)
    turn, missed = reweighted_motion(
        rows, moved.T / length, steps=STEPS, scale=scale, start=motion[:3], prior=prior
    )
    weight = share / (scale(missed) ** 2 + missed**2)
    return turn, np.einsum("idn,jdn,n->ij", rows, rows, weight), sense


def _doubt(frames: Sequence[ExposedFrame], motions: Array, spreads: Array) -> float:
    """Return by what part of their spreads (N,) a trajectory's rotations are off: the likeliest of `FACTORS`.

    A shake faster than the frames looks like a slow one in their poses: only smears show that it is not.
    """
    apart, own, path = [], [], []
    for frame, motion, spread in zip(frames, motions, spreads, strict=True):
        turn, information, sense = _turn(frame, motion, TINY)
        if information.any():
            apart.append(turn - sense * motion[:3])
            own.append(np.linalg.pinv(information, hermitian=True))
            path.append(spread**2)
    if not apart:
        return float(FACTORS[0])
    d, C, variance = np.array(apart), np.array(own), np.array(path)[:, None, None]
    likely = []
    for factor in FACTORS:
        covariance = C + np.eye(3) * variance * factor**2
        far = (d * np.linalg.solve(covariance, d[..., None])[..., 0]).sum(axis=1)
        spread_log = np.linalg.slogdet(covariance)[1]
        likely.append(-0.5 * (spread_log + (FREEDOM + 3) * np.log1p(far / FREEDOM)).sum())
    return float(FACTORS[int(np.argmax(likely))])
