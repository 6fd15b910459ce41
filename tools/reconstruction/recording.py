"""Videos of blurred frames with true poses: rendered ones, and one of 7-Scenes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from blur2view.arrays import AnyArray as Array
from blur2view.errors import Blur2ViewError
from blur2view.geometry.rotation import rotation_vector
from tools.reconstruction.alignment import Motion
from tools.reconstruction.sequence import read_sequence, relative_pose


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """N frames of one camera.

    Parameters
    ----------
    name : str
    paths : list of Path
        In order of time.
    K : ndarray of shape (3, 3)
        Our pixels.
    poses : ndarray of shape (N, 3, 4)
        True cam_from_world at mid exposure.
    motion : Motion
        During each exposure; where the exposure is not known, during the time from frame to frame.
    exposure_known : bool
        False: true motions hold up to one factor for the whole recording.
    """

    name: str
    paths: list[Path]
    K: Array
    poses: Array
    motion: Motion
    exposure_known: bool

    def first(self, count: int | None) -> Recording:
        """Return the first frames only."""
        motion = Motion(
            rotations=self.motion.rotations[:count], translations=self.motion.translations[:count]
        )
        return replace(self, paths=self.paths[:count], poses=self.poses[:count], motion=motion)


def rendered_recording(folder: Path) -> Recording:
    """Return a video of :mod:`tools.reconstruction.sequence`; Blur2ViewError if there is none."""
    paths, truth = read_sequence(folder)
    return Recording(
        name="rendered",
        paths=paths,
        K=truth.K,
        poses=truth.poses[:, 1],
        motion=Motion.between(truth.poses[:, 0], truth.poses[:, 2]),
        exposure_known=True,
    )


def redkitchen_recording(folder: Path) -> Recording:
    """Return consecutive frames with ``poses.npz`` (frame, cam_from_world, K), as in redkitchen_sequence.

    Blur2ViewError if there are none.
    """
    if not (folder / "poses.npz").exists():
        raise Blur2ViewError(f"{folder}: has no poses.npz; give the folder of redkitchen_sequence")
    with np.load(folder / "poses.npz") as stored:
        frames, poses, K = stored["frame"], stored["cam_from_world"].astype(float), stored["K"].astype(float)
    return Recording(
        name="RedKitchen",
        paths=[folder / f"{frame:06d}.jpg" for frame in frames],
        K=K,
        poses=poses,
        motion=motion_per_frame(poses),
        exposure_known=False,
    )


def motion_per_frame(poses: Array) -> Motion:
    """Return the motion per frame interval: half of that from the frame before to the one after."""
    last = len(poses) - 1
    rotations, translations = [], []
    for k in range(len(poses)):
        before, after = max(k - 1, 0), min(k + 1, last)
        relative = relative_pose(poses[before], poses[after])
        rotations.append(rotation_vector(relative[:, :3]) / (after - before))
        translations.append(relative[:, 3] / (after - before))
    return Motion(rotations=np.array(rotations), translations=np.array(translations))
