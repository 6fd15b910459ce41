"""The document of ``blur2view segment``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from blur2view.results.document import Document, FailureDocument, Matrix
from blur2view.results.estimate import EstimateDocument
from blur2view.results.pose import CovarianceDocument, PoseDocument

if TYPE_CHECKING:
    from blur2view.segmentation.mask import MotionMask


@dataclass(frozen=True, kw_only=True)
class RegionDocument(Document):
    """One connected part of a photograph that moves by itself."""

    area_px: int
    """Its number of pixels."""
    box: list[int]
    """x, y, width and height of its bounding box."""
    centroid: list[float]
    """Mean x and y of its pixels."""
    probability: float
    """Mean probability of moving of its pixels."""


@dataclass(frozen=True, kw_only=True)
class MaskDocument(Document):
    """The document of one photograph of ``blur2view segment``; null where there is no such value."""

    image: str
    """The photograph as it was named."""
    width: int
    height: int
    """Its size in pixels, upright."""
    F: Matrix | None
    H: Matrix | None
    """Fundamental matrix and homography of the camera's motion, as of ``blur2view estimate``."""
    K: Matrix | None
    E: Matrix | None
    """Calibration matrix and essential matrix, as there."""
    cam2_from_cam1: PoseDocument | None
    pose_covariance: CovarianceDocument | None
    """The camera's pose and its covariance, as there."""
    config: str
    """The configuration, a name of COLMAP's TwoViewGeometryConfiguration."""
    parallax: str
    """proven, undecided or absent."""
    geometry_reason: str
    """One sentence with the figures that decided on the configuration."""
    reason: str
    """What the motion of a pixel was measured against."""
    labels: dict[str, int]
    """The grey of static, moving and unobservable pixels in the mask: 0, 255 and 128."""
    shares: dict[str, float]
    """The share of the pixels with each of these labels."""
    regions: list[RegionDocument]
    """The connected moving parts, largest first: area_px, box (x, y, width, height), centroid and probability
    (mean of moving)."""
    beta: float
    max_error_px: float
    seed: int
    """The options of these names."""
    model_id: str
    """The weights of the smear network."""
    timings_s: dict[str, float] | None
    """Seconds per step: read, predict, select, solve, segment; null with --no-timings."""

    @classmethod
    def of(cls, estimate: EstimateDocument, mask: MotionMask, segment_s: float) -> MaskDocument:
        """Return the document of a mask that took so many seconds, of the photograph of an estimate."""
        from blur2view.segmentation.formats import GREY
        from blur2view.segmentation.mask import MotionLabel

        same = cls.__dataclass_fields__.keys() & EstimateDocument.__dataclass_fields__.keys()
        values = {name: getattr(estimate, name) for name in same} | {
            "geometry_reason": estimate.reason,
            "reason": mask.reason,
            "labels": {label.name.lower(): int(GREY[label]) for label in MotionLabel},
            "shares": {label.name.lower(): float((mask.labels == label).mean()) for label in MotionLabel},
            "regions": [RegionDocument.from_attributes(region) for region in mask.regions],
            "timings_s": estimate.timings_s and estimate.timings_s | {"segment": segment_s},
        }
        return cls(**values)


@dataclass(frozen=True, kw_only=True)
class MasksDocument(Document):
    """What ``blur2view segment --json`` prints."""

    masks: list[MaskDocument]
    """One document per photograph."""
    failures: list[FailureDocument]
    """Photographs that failed: image, error."""
