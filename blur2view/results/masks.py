"""The document of ``blur2view segment``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from blur2view.results.document import Document, Matrix, part
from blur2view.results.estimate import EstimateDocument

if TYPE_CHECKING:
    from blur2view.movers.mask import MotionMask


@dataclass(frozen=True, kw_only=True)
class MaskDocument(Document):
    """The document of one photograph of ``blur2view segment``; null where there is no such value."""

    image: str
    width: int
    height: int
    F: Matrix | None
    H: Matrix | None
    K: Matrix | None
    E: Matrix | None
    cam2_from_cam1: dict[str, Any] | None
    pose_covariance: dict[str, Any] | None
    config: str
    parallax: str
    """The photograph and the camera's motion, as of ``blur2view estimate``."""
    geometry_reason: str
    """One sentence with the figures that decided on the configuration."""
    reason: str
    """What the motion of a pixel was measured against."""
    labels: dict[str, int]
    """The grey of static, moving and unobservable pixels in the mask: 0, 255 and 128."""
    shares: dict[str, float]
    """The share of the pixels with each of these labels."""
    regions: list[dict[str, Any] | None]
    """The connected moving parts, largest first: area_px, box (x, y, width, height), centroid and probability
    (mean of moving)."""
    beta: float
    max_error_px: float
    seed: int
    model_id: str
    """The options of these names, and the weights of the smear network."""
    timings_s: dict[str, float] | None
    """Seconds per step: read, predict, select, solve, segment; null with --no-timings."""

    @classmethod
    def of(cls, estimate: EstimateDocument, mask: MotionMask, segment_s: float) -> MaskDocument:
        """Return the document of a mask that took so many seconds, of the photograph of an estimate."""
        from blur2view.movers.formats import GREY
        from blur2view.movers.mask import MotionLabel

        return cls.gathered(
            estimate,
            geometry_reason=estimate.reason,
            reason=mask.reason,
            labels={label.name.lower(): int(GREY[label]) for label in MotionLabel},
            shares={label.name.lower(): float((mask.labels == label).mean()) for label in MotionLabel},
            regions=[part(one, "area_px", "box", "centroid", "probability") for one in mask.regions],
            timings_s=estimate.timings_s and estimate.timings_s | {"segment": segment_s},
        )
