"""The two-view geometry of one exposure, with its configuration and the facts that decided on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera import HALF_PIXEL
from blur2view.geometry.configuration import Configuration, ModelRow, MotionModel, Parallax, Refusal, Support
from blur2view.geometry.epipolar import unit_norm
from blur2view.geometry.pose import AngularVelocity, PoseCovariance, RigidTransform
from blur2view.geometry.reason import explanation

COLMAP_FROM_PIXEL, PIXEL_FROM_COLMAP = (
    np.array([[1, 0, half], [0, 1, half], [0, 0, 1.0]]) for half in (HALF_PIXEL, -HALF_PIXEL)
)


@dataclass(frozen=True, kw_only=True)
class TimeDirection:
    """Which end of the exposure came first: whether it is ``known``, and how surely, 0 to 1."""

    known: bool = False
    confidence: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TwoViewGeometry:
    """Two-view geometry of N smears, from shutter-open (1) to shutter-close (2), in undistorted pixels.

    ``points2^T F points1 = 0`` and ``points2 ~ H points1``; F and H have unit norm. Which end came first
    cannot be seen: F or its transpose, H or its inverse, the pose or its inverse, every order of the ends
    exchanged, are one answer. Where the direction of the translation is not known the translation is zero,
    and the rotation is the one that explains the smears alone, or the mean over all directions.
    """

    F: Array | None  # (3, 3); None where no F can be trusted
    config: Configuration
    inlier_mask: NDArray[np.bool_]  # (N,): smears that follow F or, without F, H
    second_end_is_open: NDArray[np.bool_]  # (N,): where ends[:, 1] is the open end; nowhere without F and H
    H: Array | None = None  # (3, 3), where a homography explains the smears; with F if parallax is undecided
    cam2_from_cam1: RigidTransform | None = None  # None unless the intrinsics are known
    # Of the pose. Where that has no translation the rotation's covariance includes what an unseen translation
    # would change, unless the configuration is PANORAMIC.
    covariance: PoseCovariance | None = None
    models: tuple[ModelRow, ...] = ()  # those compared, likeliest first
    independent_smears: float = 0.0  # how many smears err independently of each other
    support_by_chance: float = 0.0  # share of smears that would be inliers if their directions were random
    # Of the robust search for F: samples that it drew, and share of the smears that followed its best F to
    # within three standard deviations, from which it knows when to end.
    num_trials: int = 0
    inlier_ratio: float = 0.0
    refusal: Refusal | None = None  # why no model was fitted
    support: Support | None = None  # of the F of least cost, be it given or not
    few_follow_F: bool = False  # whether parallax would be proven if more smears followed F
    # With a rolling shutter the geometry of the other order in time, which is not the inverse of this one.
    backward: TwoViewGeometry | None = None
    one_way: bool = False  # whether a rolling shutter leaves no such smears in the other order in time

    def __repr__(self) -> str:
        names = [name for name in ("F", "H", "E") if getattr(self, name) is not None]
        matrices = " and ".join(names) or "no F"
        fit = f"{int(self.inlier_mask.sum())} of {len(self.inlier_mask)} smears fit"
        return f"<TwoViewGeometry {self.config}: {matrices}; {fit}>"

    @property
    def reason(self) -> str:
        """Why the configuration is what it is: one sentence with the figures that decided."""
        return explanation(self)

    @property
    def E(self) -> Array | None:
        """Essential matrix [t]x R (3, 3) of the pose; None without a pose or without its translation."""
        pose = self.cam2_from_cam1
        return None if pose is None or not pose.translation.any() else pose.essential

    @property
    def insufficient_data(self) -> bool:
        """Whether too little is seen for any conclusion."""
        return self.refusal is not None and self.refusal.cause.leaves_motion_open

    @property
    def stood_still(self) -> bool:
        """Whether the camera held still, as far as the smears show."""
        return self.config is Configuration.DEGENERATE and not self.insufficient_data

    @property
    def model(self) -> MotionModel:
        """Likeliest model of the motion; NONE where no models were compared."""
        return self.models[0].model if self.models else MotionModel.NONE

    @property
    def parallax_probability(self) -> float | None:
        """Probability of parallax: 0 where that was not compared, None where no models were."""
        odds = {row.model: row.probability for row in self.models}
        return odds.get(MotionModel.PARALLAX, 0.0) if odds else None

    @property
    def parallax(self) -> Parallax:
        """Whether parallax is proven (only CALIBRATED and UNCALIBRATED are), undecided or absent."""
        if self.config in (Configuration.CALIBRATED, Configuration.UNCALIBRATED):
            return Parallax.PROVEN
        undecided = self.insufficient_data or self.config is Configuration.UNDEFINED or self.F is not None
        return Parallax.UNDECIDED if undecided else Parallax.ABSENT

    def reversed(self) -> TwoViewGeometry:
        """Return the same motion with time reversed: `backward` if there is one, else the inverse."""
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
        """Return the rotation over the exposure time, rad/s, with its covariance; None without a pose."""
        pose, covariance = self.cam2_from_cam1, self.covariance
        if pose is None or covariance is None:
            return None
        spread = covariance.matrix[:3, :3] / exposure_s**2
        return AngularVelocity(mean=pose.rotation_vector / exposure_s, covariance=spread)

    def to_pycolmap(self) -> Any:
        """Return a pycolmap.TwoViewGeometry: F and H of unit norm, of COLMAP's pixels, and inlier matches.

        Match (i, i) is smear i: the keypoints of the two views are the ends of the smears in their order
        (`views.ExposureViews`). F and H of a distorting camera are of undistorted pixels, as everywhere here.
        """
        import pycolmap

        F, H, pose = self.F, self.H, self.cam2_from_cam1
        cam2_from_cam1 = None
        if pose is not None:
            cam2_from_cam1 = pycolmap.Rigid3d(pycolmap.Rotation3d(pose.rotation), pose.translation)
        inliers = np.flatnonzero(self.inlier_mask)
        return pycolmap.TwoViewGeometry(
            config=pycolmap.TwoViewGeometryConfiguration.__members__[self.config.name],
            inlier_matches=np.stack([inliers, inliers], axis=1).astype(np.uint32),
            F=None if F is None else unit_norm(PIXEL_FROM_COLMAP.T @ F @ PIXEL_FROM_COLMAP),
            E=self.E,
            H=None if H is None else unit_norm(COLMAP_FROM_PIXEL @ H @ PIXEL_FROM_COLMAP),
            cam2_from_cam1=cam2_from_cam1,
        )
