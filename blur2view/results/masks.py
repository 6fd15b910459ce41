"""The document of ``blur2view segment``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from blur2view.results.document import Document, FailureDocument, Matrix
from blur2view.results.estimate import EstimateDocument
from blur2view.results.pose import CovarianceDocument, PoseDocument

if TYPE_CHECKING:
    from blur2view.segmentation.mask import MotionMask
    from blur2view.segmentation.pixels import MovingRegion


@dataclass(frozen=True, kw_only=True)
class RegionDocument(Document):
    """One connected part of a photograph that moves by itself.

    Parameters
    ----------
    area_px : int
        Its number of pixels.
    box : list of 4 int
        x, y, width and height of its bounding box.
    centroid : list of 2 float
        Mean x and y of its pixels.
    probability : float
        Mean probability of moving of its pixels.
    """

    area_px: int
    box: list[int]
    centroid: list[float]
    probability: float

    @classmethod
    def of(cls, region: MovingRegion) -> RegionDocument:
        """Return the document of a region."""
        box, centroid = list(region.box), list(region.centroid)
        return cls(area_px=region.area_px, box=box, centroid=centroid, probability=region.probability)


@dataclass(frozen=True, kw_only=True)
class MaskDocument(Document):
    """The document of one photograph of ``blur2view segment``; null where there is no such value.

    Parameters
    ----------
    image : str
        The photograph as it was named.
    width, height : int
        Its size in pixels, upright.
    F, H : 3x3 or null
        Fundamental matrix and homography of the camera's motion, as of ``blur2view estimate``.
    K, E : 3x3 or null
        Calibration matrix and essential matrix, as there.
    cam2_from_cam1, pose_covariance : object or null
        The camera's pose and its covariance, as there.
    config : str
        The configuration, a name of COLMAP's TwoViewGeometryConfiguration.
    parallax : str
        proven, undecided or absent.
    geometry_reason : str
        One sentence with the figures that decided on the configuration.
    reason : str
        What the motion of a pixel was measured against.
    labels : object
        The grey of static, moving and unobservable pixels in the mask: 0, 255 and 128.
    shares : object
        The share of the pixels with each of these labels.
    regions : list
        The connected moving parts, largest first: area_px, box (x, y, width, height), centroid and
        probability (mean of moving).
    beta, max_error_px, seed : number
        The options of these names.
    model_id : str
        The weights of the smear network.
    timings_s : object or null
        Seconds per step: read, predict, select, solve, segment; null with --no-timings.
    """

    image: str
    width: int
    height: int
    F: Matrix | None
    H: Matrix | None
    K: Matrix | None
    E: Matrix | None
    cam2_from_cam1: PoseDocument | None
    pose_covariance: CovarianceDocument | None
    config: str
    parallax: str
    geometry_reason: str
    reason: str
    labels: dict[str, int]
    shares: dict[str, float]
    regions: list[RegionDocument]
    beta: float
    max_error_px: float
    seed: int
    model_id: str
    timings_s: dict[str, float] | None

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
            "regions": [RegionDocument.of(region) for region in mask.regions],
            "timings_s": (estimate.timings_s or {}) | {"segment": segment_s},
        }
        return cls(**values)


@dataclass(frozen=True, kw_only=True)
class MasksDocument(Document):
    """What ``blur2view segment --json`` prints.

    Parameters
    ----------
    masks : list
        One document per photograph.
    failures : list
        Photographs that failed: image, error.
    """

    masks: list[MaskDocument]
    failures: list[FailureDocument]
