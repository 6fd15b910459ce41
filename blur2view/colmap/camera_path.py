"""Where a spline through the poses of frames before and after expects a frame, and how far off it is."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from blur2view.arrays import TINY, Array
from blur2view.colmap.exposure_motion import change_of
from blur2view.geometry.rotation import rotation_matrix, rotation_vector

KNOTS = 3  # known frames on each side through which the spline goes
TRIALS = 40  # known frames, the nearest, that say how far off the spline is
MEDIAN_OF_THREE = 1.54  # median length of a vector of three standard deviations of one


@dataclass(frozen=True, kw_only=True, eq=False)
class Expected:
    """Where a spline expects a frame: a pose (3, 4), how it errs, and the motion of half two frames."""

    pose: Array
    rotation_rad: float  # standard deviation of each of three
    position: float  # the same, units of the model
    motion: Array  # (6,)


class CameraPath:
    """Poses cam_from_world (N, 3, 4) of frames at times (N,), and a spline through them."""

    def __init__(self, times: Array, poses: Array) -> None:
        order = np.argsort(times)
        self.times, self.poses = np.asarray(times, float)[order], np.asarray(poses)[order]

    def expected(self, time: float) -> Expected:
        """Return where the spline expects a frame at a time, and how far off it is, by frames that are known.

        These are left out with their neighbours, as far as those of the time are away.
        """
        before, after = self.times[self.times < time], self.times[self.times > time]
        gap = (time - before[-1] if len(before) else np.inf), (after[0] - time if len(after) else np.inf)
        errors = []
        for index in np.argsort(np.abs(self.times - time), kind="stable")[:TRIALS]:
            there, pose = self.times[index], self.poses[index]
            others = (self.times <= there - gap[0]) | (self.times >= there + gap[1])
            sides = [np.any(self.times[others] < there), np.any(self.times[others] > there)]
            if sides == [bool(len(before)), bool(len(after))]:
                change = change_of(pose, self._at(there, others))
                errors.append((np.linalg.norm(change[:3]), np.linalg.norm(change[3:])))
        spread = np.median(errors, axis=0) / MEDIAN_OF_THREE if errors else np.full(2, np.inf)
        every = np.ones(len(self.times), bool)
        first, pose, last = (self._at(time + step, every) for step in (-0.5, 0.0, 0.5))
        rotation_rad, position = map(float, np.maximum(spread, TINY))
        motion = change_of(first, last)
        return Expected(pose=pose, rotation_rad=rotation_rad, position=position, motion=motion)

    def _at(self, time: float, used: Array) -> Array:
        """Return the pose at a time by a cubic through frames before and after.

        By a line where one side is empty. Rotations are those from the nearest frame's, as vectors.
        """
        times, poses = self.times[used], self.poses[used]
        split = int(np.searchsorted(times, time))
        near = slice(max(0, split - KNOTS), split + KNOTS)
        if split in (0, len(times)):
            near = slice(0, 2) if split == 0 else slice(len(times) - 2, len(times))
        times, poses = times[near], poses[near]
        middle = poses[np.argmin(np.abs(times - time))]
        turns = [rotation_vector(pose[:, :3] @ middle[:, :3].T) for pose in poses]
        centres = [-pose[:, :3].T @ pose[:, 3] for pose in poses]
        values = np.column_stack([turns, centres])
        place = (
            make_interp_spline(times, values, k=min(3, len(times) - 1))(time) if len(times) > 1 else values[0]
        )
        R = rotation_matrix(place[:3]) @ middle[:, :3]
        return np.column_stack([R, -R @ place[3:]])
