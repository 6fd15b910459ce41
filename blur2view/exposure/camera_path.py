"""A camera's path through the poses of frames: a spline, and how far off it is.

Poses are cam_from_world (3, 4); a *change* (6,) from one to another is a rotation vector and a translation of
points in the first camera.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from blur2view.arrays import TINY, Array
from blur2view.geometry.rotation import rotation_matrix, rotation_vector

KNOTS = 4  # frames on each side through which the spline goes
MOST_BEYOND = 0.5  # frames beyond the last to which the cubic goes, and a line farther
TRIALS = 40  # frames, the nearest, that say how far off the spline is
MEDIAN_OF_THREE = 1.54  # median length of a vector of three standard deviations of one


def change_of(first: Array, second: Array) -> Array:
    """Return the change (6,) that leads from one pose (3, 4) to another."""
    R = second[:, :3] @ first[:, :3].T
    return np.append(rotation_vector(R), second[:, 3] - R @ first[:, 3])


def changed(pose: Array, change: Array) -> Array:
    """Return a pose (3, 4) after a change (6,)."""
    R = rotation_matrix(change[:3])
    return np.column_stack([R @ pose[:, :3], R @ pose[:, 3] + change[3:]])


@dataclass(frozen=True, kw_only=True, eq=False)
class Expected:
    """Where a spline expects a frame: a pose (3, 4), how it errs, and the change of a frame about it."""

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
        """Return the pose at a time by a cubic through frames before and after, None of fewer than two.

        By a line where one side is empty. Rotations are those from the nearest frame's, as vectors. ``used``
        are the frames (N,), bool, that it goes through: by default all.
        """
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
        """Return where the spline expects a frame at a time, and how far off it is; None as of `at`.

        By frames that are known: these are left out with their neighbours, as far as those of the time are
        away.
        """
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
        rotation_rad, position = map(float, np.maximum(spread, TINY))
        return Expected(
            pose=pose, rotation_rad=rotation_rad, position=position, motion=change_of(first, last)
        )
