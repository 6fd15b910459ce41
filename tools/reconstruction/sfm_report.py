"""What COLMAP and we made of a video, beside its truth, and the tables of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from blur2view.arrays import AnyArray as Array
from blur2view.exposure.views import CLOSE, OPEN
from tools.reconstruction.alignment import (
    Motion,
    MotionErrors,
    Similarity,
    align,
    centres,
    common_scale,
    rotation_errors_deg,
)
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
    """A recording reconstructed, and every photograph's own estimate.

    Parameters
    ----------
    recording : Recording
    models : dict of str to Model
        "without views", "views placed" (by `place_views`), "views mapped" (by the incremental mapper).
    estimated : Motion
        From the database: single photographs, translations of unit length; NaN without a pose.
    time_known : int
        Photographs whose time direction ``to-colmap`` calls known.
    model_id : str
    """

    recording: Recording
    models: dict[str, Model]
    estimated: Motion
    time_known: int
    model_id: str

    @property
    def names(self) -> list[str]:
        """Return the names of the photographs."""
        return [path.name for path in self.recording.paths]

    def motion_of(self, model: Model) -> Motion:
        """Return the motion during the exposures by a model's views, in the true scale; NaN without one."""
        first, last = (model.of([name + end for name in self.names]) for end in (OPEN, CLOSE))
        scale = self.alignment_of(model).scale if model.poses else 1.0
        return Motion.between(first, last).scaled(1.0, scale)

    def alignment_of(self, model: Model) -> Similarity:
        """Return the alignment of a model's photographs to the truth."""
        poses = model.of(self.names)
        seen = np.isfinite(poses).all(axis=(1, 2))
        return align(poses[seen], self.recording.poses[seen])

    def exposure(self, estimated: Motion) -> float:
        """Return exposure over frame interval, or over the true one if known, by the estimated rotations."""
        return common_scale(estimated.rotations, self.recording.motion.rotations)

    def errors(self, estimated: Motion) -> MotionErrors:
        """Return the errors of a motion; of unknown exposures the truth is scaled to it by one factor."""
        factor = 1.0 if self.recording.exposure_known else self.exposure(estimated)
        return MotionErrors.of(estimated, self.recording.motion.scaled(factor, factor))


def read_model(folder: Path | None) -> Model:
    """Return the poses of a model that COLMAP wrote, none without a model."""
    import pycolmap

    if folder is None:
        return Model(poses={}, points=0, error_px=float("nan"))
    model = pycolmap.Reconstruction(folder)
    posed = {image.name: image.cam_from_world().matrix() for image in model.images.values() if image.has_pose}
    error_px = model.compute_mean_reprojection_error()
    return Model(poses=posed, points=model.num_points3D(), error_px=error_px)


def markdown(result: Result) -> str:
    """Return both tables of a recording."""
    what = "true exposure" if result.recording.exposure_known else "frame interval"
    motions = {name: result.motion_of(model) for name, model in result.models.items()}
    motions["single photographs"] = result.estimated
    rows = [
        f"## {result.recording.name}: {len(result.names)} frames, {result.model_id}",
        "",
        "| model | photographs | views | points | reprojection error, px "
        "| median rotation error, degrees | median position error, of the path's extent |",
        "|---" * 7 + "|",
        *(model_row(name, result, model) for name, model in result.models.items()),
        "",
        f"Time direction called known for {result.time_known} photographs.",
        "",
        "| motion during the exposure, median | photographs | rotation error | time direction right "
        f"| translation's direction, degrees | translation error | exposure over {what} |",
        "|---" * 7 + "|",
        *(motion_row(name, result, motion) for name, motion in motions.items()),
        "",
    ]
    return "\n".join(rows)


def model_row(name: str, result: Result, model: Model) -> str:
    """Return size and pose errors of a model."""
    if not model.poses:
        return f"| {name} | 0 | 0 | 0 | - | - | - |"
    extent = float(np.linalg.norm(np.ptp(centres(result.recording.poses), axis=0)))
    poses = model.of(result.names)
    seen = np.isfinite(poses).all(axis=(1, 2))
    aligned, true = result.alignment_of(model).poses(poses[seen]), result.recording.poses[seen]
    off = np.linalg.norm(centres(aligned) - centres(true), axis=1) / extent
    sizes = f"{seen.sum()} | {len(model.poses) - seen.sum()} | {model.points} | {model.error_px:.3f}"
    return (
        f"| {name} | {sizes} | {np.median(rotation_errors_deg(aligned, true)):.3f} | {np.median(off):.2%} |"
    )


def motion_row(name: str, result: Result, motion: Motion) -> str:
    """Return medians over the frames with a motion; translations of single photographs have no length."""
    errors = result.errors(motion)
    seen = np.isfinite(errors.rotation)
    if not seen.any():
        return f"| {name} | 0 | - | - | - | - | - |"
    translation = f"{np.median(errors.translation[seen]):.0%}" if motion is not result.estimated else "-"
    return (
        f"| {name} | {seen.sum()} | {np.median(errors.rotation[seen]):.1%} "
        f"| {np.mean(errors.forward[seen]):.0%} | {np.median(errors.heading_deg[seen]):.1f} | {translation} "
        f"| {result.exposure(motion):.3f} |"
    )
