"""What COLMAP and we made of a video, beside its truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.exposure.views import CLOSE, OPEN
from tools.reconstruction.alignment import Motion, MotionErrors, Similarity, align, common_scale
from tools.reconstruction.recording import Recording

Array = NDArray[Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """What COLMAP built: poses cam_from_world by image name."""

    poses: dict[str, Array]
    points: int
    error_px: float

    def of(self, names: Sequence[str]) -> Array:
        """Give the poses (N, 3, 4) of images; NaN where one is not registered."""
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
        """Of the photographs."""
        return [path.name for path in self.recording.paths]

    def motion_of(self, model: Model) -> Motion:
        """Motion during the exposures by a model's views, in the truth's scale; NaN without a model."""
        if not model.poses:
            unknown = np.full((len(self.names), 3), np.nan)
            return Motion(turns=unknown, moves=unknown)
        first, last = (model.of([name + end for name in self.names]) for end in (OPEN, CLOSE))
        return Motion.between(first, last).scaled(1.0, self.alignment_of(model).scale)

    def alignment_of(self, model: Model) -> Similarity:
        """Align a model's photographs to the truth."""
        poses = model.of(self.names)
        seen = np.isfinite(poses).all(axis=(1, 2))
        return align(poses[seen], self.recording.poses[seen])

    @property
    def motion(self) -> Motion:
        """Motion during the exposures by the joined model."""
        return self.motion_of(self.joined)

    @property
    def true_motion(self) -> Motion:
        """True motion in the scale of the views as they were placed, for the picture."""
        return self.true_motion_for(self.motion_of(self.placed))

    def true_motion_for(self, found: Motion) -> Motion:
        """Give the true motion; of unknown exposures scaled to the rotations found, by one factor."""
        factor = 1.0 if self.recording.exposure_known else self.exposure(found)
        return self.recording.motion.scaled(factor, factor)

    def exposure(self, found: Motion) -> float:
        """Exposure over frame interval, or over what is known to be true, as the rotations found tell."""
        return common_scale(found.turns, self.recording.motion.turns)

    def errors(self, found: Motion) -> MotionErrors:
        """Compare a motion with the true one."""
        return MotionErrors.of(found, self.true_motion_for(found))


def read_model(folder: Path | None) -> Model:
    """Read a model that COLMAP wrote; of none there are no poses."""
    import pycolmap

    if folder is None:
        return Model(poses={}, points=0, error_px=float("nan"))
    model = pycolmap.Reconstruction(folder)
    posed = {image.name: image.cam_from_world().matrix() for image in model.images.values() if image.has_pose}
    error_px = model.compute_mean_reprojection_error()
    return Model(poses=posed, points=model.num_points3D(), error_px=error_px)
