"""What can be found about the motion of an exposure: facts, which `geometry.reason` puts into words."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Configuration(StrEnum):
    """Kind of two-view geometry, named and spelled as COLMAP's TwoViewGeometryConfiguration.

    UNCALIBRATED and CALIBRATED: parallax is proven, without and with known intrinsics. PANORAMIC and PLANAR:
    a rotation, or a plane, explains the smears. PLANAR_OR_PANORAMIC: one of them does, but "no motion" is the
    likeliest model, at a probability of at most one half. DEGENERATE: no motion, or too little is seen.
    UNDEFINED: the best F explains hardly more smears than chance.
    """

    UNDEFINED = "UNDEFINED"
    DEGENERATE = "DEGENERATE"
    CALIBRATED = "CALIBRATED"
    UNCALIBRATED = "UNCALIBRATED"
    PLANAR = "PLANAR"
    PANORAMIC = "PANORAMIC"
    PLANAR_OR_PANORAMIC = "PLANAR_OR_PANORAMIC"


class Parallax(StrEnum):
    """Whether smears show things at different depths: only these determine F and the translation."""

    PROVEN = "proven"  # no homography explains the smears, even with errors that neighbours share
    UNDECIDED = "undecided"  # shared errors could look like it, or too little is seen
    ABSENT = "absent"  # a homography explains all smears, or nothing moved


class MotionModel(StrEnum):
    """Model of the camera's motion; in brackets its number of parameters, with a rolling shutter 3 more."""

    STILL = "no motion"  # a camera that holds still (0)
    ROTATION = "rotation"  # H of a rotation (3, not counting 3 intrinsics that have a prior)
    PLANE = "plane"  # any H (8)
    PARALLAX = "parallax"  # any H, and parallax along the epipolar lines of F (10)
    NONE = "none"  # no models were compared


@dataclass(frozen=True, kw_only=True)
class ModelRow:
    """One model: its free parameters, log-likelihood (of the effective number of smears) and probability."""

    model: MotionModel
    parameters: int
    log_likelihood: float
    probability: float


class Cause(StrEnum):
    """Why there is neither F nor H, although no models were compared."""

    FEW_SMEARS = "few smears"
    SHORT_SMEARS = "short smears"
    SMALL_PART = "small part"  # of the picture shows smears
    ONE_LINE = "one line"  # holds all smears
    WITHIN_ERRORS = "within errors"  # are the lengths of the smears
    CAMERA_AT_REST = "camera at rest"
    NO_BLUR_SEEN = "no blur seen"  # that a camera's motion leaves
    UNCLEAR = "unclear"  # whether the camera moved
    NOT_ASKED_FOR = "not asked for"

    @property
    def leaves_motion_open(self) -> bool:
        """Whether too little is seen, so that the camera may have moved."""
        seen = (Cause.SHORT_SMEARS, Cause.WITHIN_ERRORS, Cause.CAMERA_AT_REST)
        return self not in seen


@dataclass(frozen=True, kw_only=True)
class Refusal:
    """Why no geometry is given: the cause, the figure that decided, and the limit that it misses."""

    cause: Cause
    value: float = 0.0  # smears, pixels, or a share of the picture
    limit: float = 0.0
    blur: str = ""  # the kind of blur with its figures, where that decided: `Blur.reason`


@dataclass(frozen=True, kw_only=True)
class Support:
    """How many of the smears follow the F of least cost, be it given or not."""

    num_inliers: int
    count: int  # of smears
    by_chance: float  # share that would follow it if directions were random

    @property
    def agreement(self) -> float:
        """Share of the smears that follow F beyond chance; below 0 if fewer follow it than by chance."""
        return (self.num_inliers / self.count - self.by_chance) / max(1 - self.by_chance, 1e-9)
