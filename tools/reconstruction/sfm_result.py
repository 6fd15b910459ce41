"""What COLMAP and we made of a video, beside its truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.arrays import AnyArray as Array
from blur2view.exposure.views import CLOSE, OPEN
from tools.reconstruction.alignment import Motion, MotionErrors, Similarity, align, common_scale
from tools.reconstruction.recording import Recording


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """What COLMAP built: poses cam_from_world by image name."""

    poses: dict[str, Array]
    points: int
    error_px: float

    def of(self, names: Sequence[str]) -> Array:
        """Return the poses (N, 3, 4) of images; NaN where one is not registered."""
        return np.stack([self.poses.get(name, np.full((3, 4), np.nan)) for name in names])


@dataclass(frozen=True, kw_only=True, eq=False)
class Result:
    """A recording reconstructed: without views, with views, and every photograph's own estimate.

    Parameters
    ----------
    recording : Recording
    without, placed, joined, averaged : Model
        With views: placed by `place_views`, joined by the incremental mapper, by global mapping.
    estimated : Motion
        From the database: single photographs, translations of unit length; NaN without a pose.
    facts : list of dict
        What ``to-colmap --json`` says of every photograph.
    model_id : str
    """

    recording: Recording
    without: Model
    placed: Model
    joined: Model
    averaged: Model
    estimated: Motion
    facts: list[dict[str, Any]]
    model_id: str

    @property
    def names(self) -> list[str]:
        """Return the names of the photographs."""
        return [path.name for path in self.recording.paths]

    def motion_of(self, model: Model) -> Motion:
        """Return the motion during the exposures by a model's views, in the true scale; NaN without one."""
        if not model.poses:
            unknown = np.full((len(self.names), 3), np.nan)
            return Motion(rotations=unknown, translations=unknown)
        first, last = (model.of([name + end for name in self.names]) for end in (OPEN, CLOSE))
        return Motion.between(first, last).scaled(1.0, self.alignment_of(model).scale)

    def alignment_of(self, model: Model) -> Similarity:
        """Return the alignment of a model's photographs to the truth."""
        poses = model.of(self.names)
        seen = np.isfinite(poses).all(axis=(1, 2))
        return align(poses[seen], self.recording.poses[seen])

    @property
    def motion(self) -> Motion:
        """Return the motion during the exposures by the joined model."""
        return self.motion_of(self.joined)

    @property
    def true_motion(self) -> Motion:
        """Return the true motion in the scale of the views as they were placed, for the picture."""
        return self.true_motion_for(self.motion_of(self.placed))

    def true_motion_for(self, estimated: Motion) -> Motion:
        """Return the true motion; of unknown exposures scaled to the estimated rotations, by one factor."""
        factor = 1.0 if self.recording.exposure_known else self.exposure(estimated)
        return self.recording.motion.scaled(factor, factor)

    def exposure(self, estimated: Motion) -> float:
        """Return exposure over frame interval, or over the true one if known, by the estimated rotations."""
        return common_scale(estimated.rotations, self.recording.motion.rotations)

    def errors(self, estimated: Motion) -> MotionErrors:
        """Return the errors of a motion against the true one."""
        return MotionErrors.of(estimated, self.true_motion_for(estimated))


def read_model(folder: Path | None) -> Model:
    """Return the poses of a model that COLMAP wrote, none without a model."""
    import pycolmap

    if folder is None:
        return Model(poses={}, points=0, error_px=float("nan"))
    model = pycolmap.Reconstruction(folder)
    posed = {image.name: image.cam_from_world().matrix() for image in model.images.values() if image.has_pose}
    error_px = model.compute_mean_reprojection_error()
    return Model(poses=posed, points=model.num_points3D(), error_px=error_px)
