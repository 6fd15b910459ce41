"""The answer: the two-view geometry of one exposure, its configuration and its reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.camera import HALF_PIXEL
from blur2view.geometry.epipolar import unit_norm
from blur2view.geometry.pose import AngularVelocity, PoseCovariance, RigidTransform


class Configuration(StrEnum):
    """Kind of two-view geometry, named, spelled and counted as COLMAP's TwoViewGeometryConfiguration."""

    UNDEFINED = "UNDEFINED"
    DEGENERATE = "DEGENERATE"
    CALIBRATED = "CALIBRATED"
    UNCALIBRATED = "UNCALIBRATED"
    PLANAR = "PLANAR"
    PANORAMIC = "PANORAMIC"
    PLANAR_OR_PANORAMIC = "PLANAR_OR_PANORAMIC"
    WATERMARK = "WATERMARK"
    MULTIPLE = "MULTIPLE"


class Parallax(StrEnum):
    """Whether smears show things at different depths, which F and a translation follow from."""

    PROVEN = "proven"
    """No homography explains the smears, errors that neighbours share allowed for."""
    UNDECIDED = "undecided"
    """Parallax and errors that neighbours share look the same here, or too little is seen."""
    ABSENT = "absent"
    """A homography leaves nothing to explain, or nothing moved."""


class MotionModel(StrEnum):
    """Model of the camera's motion; in brackets its number of parameters."""

    STILL = "no motion"
    """A camera that holds still (0)."""
    ROTATION = "rotation"
    """H of a pure rotation (3, and 3 of the camera held by a prior)."""
    ROLLING_ROTATION = "rotation, rolling shutter"
    """A rotation whose rate changes down the rows of a rolling shutter (3 more, held by a prior)."""
    ROLLING_PLANE = "plane, rolling shutter"
    """A plane, and a rotation that changes down the rows (3 more, held by a prior)."""
    PLANE = "plane"
    """Any H (8)."""
    PARALLAX = "parallax"
    """A plane, and parallax along the lines of F (10)."""
    NONE = "none"
    """None: no models were compared."""


FAMILIES = {
    MotionModel.STILL: (MotionModel.STILL,),
    MotionModel.ROTATION: (MotionModel.ROTATION, MotionModel.ROLLING_ROTATION),
    MotionModel.PLANE: (MotionModel.PLANE, MotionModel.ROLLING_PLANE),
    MotionModel.PARALLAX: (MotionModel.PARALLAX,),
}
"""What a camera may have done, each with its models: a shutter of either kind."""


def likeliest_of(probability: Callable[..., float | None]) -> tuple[MotionModel, float]:
    """Return the likeliest of `FAMILIES` by what returns the probability of some models, and its own."""
    odds = {name: probability(*models) or 0.0 for name, models in FAMILIES.items()}
    return max(odds.items(), key=lambda one: one[1])


@dataclass(frozen=True, kw_only=True)
class ModelRow:
    """One model: its free parameters, its log-likelihood and its probability.

    The log-likelihood is that of the effective number of smears, with priors, 0 for smears without residuals
    whose orders are known.
    """

    model: MotionModel
    parameters: int
    log_likelihood: float
    probability: float


@dataclass(frozen=True, kw_only=True)
class ModelTable:
    """All models that were compared, likeliest first, on so many smears as if each erred for itself."""

    rows: tuple[ModelRow, ...] = ()
    effective_count: float = 0.0

    @property
    def winner(self) -> ModelRow | None:
        """The likeliest model, with its probability; None where none were compared."""
        return self.rows[0] if self.rows else None

    def probability(self, *models: MotionModel) -> float | None:
        """Return the probability that it is one of the models; None where none were compared."""
        if not self.rows:
            return None
        return sum(row.probability for row in self.rows if row.model in models)

    def likeliest(self) -> tuple[MotionModel, float]:
        """Return the likeliest of `FAMILIES` and its probability, which is 0 where none were compared."""
        return likeliest_of(self.probability)


@dataclass(frozen=True, kw_only=True)
class TimeDirection:
    """Which end of the exposure came first, as far as it is known.

    Parameters
    ----------
    known : bool
        False: open and close may be exchanged; one order was chosen arbitrarily.
    confidence : float
        In [0, 1]; 0 where the direction is not known.

    Raises
    ------
    ValueError
        If the confidence is out of range.
    """

    known: bool = False
    confidence: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.confidence <= 1:
            raise ValueError(f"confidence must be in [0, 1], got {self.confidence}")


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoViewGeometry:
    """Two-view geometry of the exposure: open (1) and close (2).

    Parameters
    ----------
    F : ndarray of shape (3, 3) or None
        ``points2^T F points1 = 0``, pixels, unit norm; F or its transpose, which is which cannot be known.
        None where no F can be trusted. Of a distorted camera that of its undistorted pixels, as H is.
    config : Configuration
    reason : str
        One sentence with the figures that decided.
    inlier_mask : ndarray of bool, shape (N,)
        Smears that follow F or, without F, H.
    second_end_is_open : ndarray of bool, shape (N,)
        Where ``ends[:, 1]`` of a smear is its open end (`two_view.order`); nowhere without F and H.
    H : ndarray of shape (3, 3) or None
        ``points2 ~ H points1``, pixels, unit norm; H or its inverse, which is which cannot be known. Given
        where a homography explains the smears; beside an F parallax is undecided.
    cam2_from_cam1 : RigidTransform or None
        Pose of known intrinsics, or its inverse with every order exchanged: time has no arrow. Where the
        direction of the translation is not known it is zero, and the rotation that which explains the smears
        alone, or the mean over all directions.
    covariance : PoseCovariance or None
        Of the pose; without a translation it allows for one that is not seen, unless a rotation
        explains the smears as well as any homography.
    table : ModelTable
        All models that were compared, likeliest first; empty where none were.
    support_by_chance : float
        Share of the smears that would be inliers of the same F or H if their directions were random.
    stood_still : bool
        Whether no motion explains the smears best.
    insufficient_data : bool
        Whether too little is seen for any conclusion, also on parallax.
    backward : TwoViewGeometry or None
        The other order in time, where a rolling shutter makes it another motion than the inverse.
    """

    F: Array | None
    config: Configuration
    reason: str
    inlier_mask: NDArray[np.bool_]
    second_end_is_open: NDArray[np.bool_]
    H: Array | None = None
    cam2_from_cam1: RigidTransform | None = None
    covariance: PoseCovariance | None = None
    table: ModelTable = field(default_factory=ModelTable)
    support_by_chance: float = 0.0
    stood_still: bool = False
    insufficient_data: bool = False
    backward: TwoViewGeometry | None = None

    @property
    def E(self) -> Array | None:
        """Essential matrix [t]x R (3, 3) of the pose; None without a pose or without its translation."""
        pose = self.cam2_from_cam1
        return None if pose is None or not pose.translation.any() else pose.essential

    @property
    def model(self) -> MotionModel:
        """Likeliest model of the motion; NONE where no models were compared."""
        return MotionModel.NONE if self.table.winner is None else self.table.winner.model

    @property
    def parallax_probability(self) -> float | None:
        """Probability of parallax; None where no models were compared."""
        return self.table.probability(MotionModel.PARALLAX)

    @property
    def rotation_probability(self) -> float | None:
        """Probability that the camera turned alone, with a global or a rolling shutter."""
        return self.table.probability(MotionModel.ROTATION, MotionModel.ROLLING_ROTATION)

    @property
    def parallax(self) -> Parallax:
        """Whether parallax is proven (only CALIBRATED and UNCALIBRATED are), undecided or absent."""
        if self.config in (Configuration.CALIBRATED, Configuration.UNCALIBRATED):
            return Parallax.PROVEN
        if self.insufficient_data or self.config is Configuration.UNDEFINED:
            return Parallax.UNDECIDED
        return Parallax.ABSENT if self.F is None else Parallax.UNDECIDED

    def reversed(self) -> TwoViewGeometry:
        """Return the same motion with time reversed: the other of two equal answers.

        Of a rolling shutter that is `backward`; without it the motion leaves no such smears the other way
        round, and the inverse is given.
        """
        if self.backward is not None:
            return replace(self.backward, backward=replace(self, backward=None))
        pose, covariance = self.cam2_from_cam1, self.covariance
        return replace(
            self,
            F=None if self.F is None else self.F.T.copy(),
            H=None if self.H is None else unit_norm(np.asarray(np.linalg.inv(self.H), float)),
            cam2_from_cam1=None if pose is None else pose.inverse(),
            covariance=None if pose is None or covariance is None else covariance.inverse(pose),
            second_end_is_open=~self.second_end_is_open,
        )

    def angular_velocity(self, exposure_s: float) -> AngularVelocity | None:
        """Return the rotation over the exposure time, with its covariance; None without a pose."""
        pose, covariance = self.cam2_from_cam1, self.covariance
        if pose is None or covariance is None:
            return None
        return AngularVelocity(
            mean=pose.rotation_vector / exposure_s, covariance=covariance.matrix[:3, :3] / exposure_s**2
        )

    def to_pycolmap(self) -> Any:
        """Return it as a pycolmap.TwoViewGeometry: COLMAP's pixels, F and H of unit norm, indices of matches.

        Of an open and a close image whose keypoints are both ends of the smears in their order
        (`views.ExposureViews`): match (i, i) is smear i. Of a distorted camera F and H are those of
        undistorted pixels, as everywhere here.
        """
        import pycolmap

        F, E, H, pose = self.F, self.E, self.H, self.cam2_from_cam1
        inliers = np.flatnonzero(self.inlier_mask)
        return pycolmap.TwoViewGeometry(
            config=pycolmap.TwoViewGeometryConfiguration.__members__[self.config.name],
            inlier_matches=np.stack([inliers, inliers], axis=1).astype(np.uint32),
            F=None if F is None else fundamental_to_colmap(F),
            E=E,
            H=None if H is None else homography_to_colmap(H),
            cam2_from_cam1=pose and pycolmap.Rigid3d(pycolmap.Rotation3d(pose.rotation), pose.translation),
        )


COLMAP_FROM_PIXEL, PIXEL_FROM_COLMAP = (
    np.array([[1, 0, half], [0, 1, half], [0, 0, 1.0]]) for half in (HALF_PIXEL, -HALF_PIXEL)
)


def fundamental_to_colmap(F: Array) -> Array:
    """Return F (3, 3) of our pixels as that of COLMAP's, of unit norm."""
    return unit_norm(PIXEL_FROM_COLMAP.T @ F @ PIXEL_FROM_COLMAP)


def homography_to_colmap(H: Array) -> Array:
    """Return H (3, 3) of our pixels as that of COLMAP's, of unit norm."""
    return unit_norm(COLMAP_FROM_PIXEL @ H @ PIXEL_FROM_COLMAP)
