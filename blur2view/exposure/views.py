"""One photograph as two virtual images: the scene as seen at shutter-open and at shutter-close."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.camera import Camera
from blur2view.geometry.configuration import Parallax
from blur2view.geometry.epipolar import (
    cross_matrix,
    fundamental_from_pose,
    serrmin,
    symmetric_skew,
    unit_norm,
)
from blur2view.geometry.pose import RigidTransform, before_both, rotation_matrix
from blur2view.geometry.two_view_geometry import TimeDirection, TwoViewGeometry
from blur2view.pipeline import Estimate
from blur2view.smears.grid import smear_ends
from blur2view.smears.matches import TINY_SIGMA_PX
from blur2view.smears.noise import across_px
from blur2view.two_view.estimate import EstimatorOptions
from blur2view.two_view.order import end_order, open_and_close

OPEN, CLOSE = "#open", "#close"  # appended to a photograph's name
# Of a smear's length. A limit in pixels as well (8) left 3 to 15 features of frames with smears of 16 to
# 20 px, where there are 900 about as exact for their length: with it 22 of 28 views of a rendered video were
# mapped, 91 % of the exposures the right way in time, without all and 100 %.
MAX_SIGMA_SHARE = 0.5
ALLOWED_SIGMA_PX = 1.5  # standard deviation that a smear of any length may have


@dataclass(frozen=True, kw_only=True, eq=False)
class ExposureViews:
    """Two virtual images of one photograph: both ends (N, 2), pixels, of smears, one scene point each."""

    name: str  # of the photograph, as the database names it
    size: tuple[int, int]  # width and height, pixels
    points_open: Array  # (N, 2)
    points_close: Array  # (N, 2)
    sampson_px: Array  # (N,) standard deviations of Sampson distances
    geometry: TwoViewGeometry  # from open (1) to close (2)
    camera: Camera | None  # known intrinsics, or approximate ones; None leaves them to COLMAP's default
    time: TimeDirection = field(default_factory=TimeDirection)
    usable: NDArray[np.bool_] | None = None  # (N,) points that are matched; None: all, where F or H is known
    smear_px: float | None = None  # length of the photograph's smear, 0 if the camera did not move

    @property
    def names(self) -> tuple[str, str]:
        """Names of both images: the photograph's with "#open" and "#close" appended."""
        return self.name + OPEN, self.name + CLOSE

    @property
    def matched(self) -> NDArray[np.int_]:
        """Indices (M,) of the usable points; empty if F and H are unknown, and with them the ends' order."""
        if self.usable is not None:
            return np.flatnonzero(self.usable)
        known = self.geometry.F is not None or self.geometry.H is not None
        return np.arange(len(self.points_open) if known else 0)

    @property
    def translation_known(self) -> bool:
        """Whether parallax is proven, or the pose has a translation."""
        pose = self.geometry.cam2_from_cam1
        return self.geometry.parallax is Parallax.PROVEN or (
            pose is not None and bool(pose.translation.any())
        )

    def reversed(self) -> Self:
        """Return the views under time reversal: ends exchanged, F and E transposed, the pose inverted."""
        first, last, geometry = self.points_close, self.points_open, self.geometry.reversed()
        return replace(self, points_open=first, points_close=last, geometry=geometry)


def views_of(name: str, estimate: Estimate) -> ExposureViews:
    """Return both virtual images of an estimate, in its order of time.

    Parameters
    ----------
    name : str
        The photograph's name, as COLMAP has it; the images are called NAME#open and NAME#close.
    estimate : Estimate
        The photograph's.

    Returns
    -------
    ExposureViews
        The ends (N, 2), pixels, of its smears at shutter-open and shutter-close, with the geometry.

    Raises
    ------
    ValueError
        If the estimate has a rolling shutter.

    Examples
    --------
    >>> import blur2view
    >>> views = blur2view.views_of("sample.jpg", blur2view.estimate("models/sample.jpg"))
    >>> views.size, views.points_open.shape == views.points_close.shape
    ((960, 540), True)
    """
    if estimate.shutter is not None:
        raise ValueError("views show the ends as they were recorded; call estimate without a shutter")
    matches, geometry, blur = estimate.matches, estimate.geometry, estimate.blur
    points_open, points_close = open_and_close(matches.ends, geometry.second_end_is_open)
    return ExposureViews(
        name=name,
        size=estimate.grid.size,
        points_open=points_open,
        points_close=points_close,
        sampson_px=matches.sampson_px,
        geometry=geometry,
        camera=estimate.camera,
        time=estimate.time,
        smear_px=None if blur.smear_px is None else blur.smear_px * blur.kind.of_camera,
    )


def keypoint_views(
    name: str, keypoints: Array, estimate: Estimate, options: EstimatorOptions | None = None
) -> ExposureViews:
    """Return both virtual images of a photograph whose features (N, 2), pixels, move by half of their smears.

    They stay where the camera did not move. Usable are features within the picture whose smears have a
    standard deviation of at most `MAX_SIGMA_SHARE` of their length or `ALLOWED_SIGMA_PX`; a coordinate
    that is not finite becomes 0.
    """
    grid, geometry, used = estimate.grid, estimate.geometry, estimate.matches
    keypoints = np.asarray(keypoints, float)
    within = (keypoints >= -0.5) & (keypoints < np.array(grid.size) - 0.5)  # False of NaN
    inside: NDArray[np.bool_] = np.all(within, axis=1)
    points = np.where(inside[:, None], keypoints, 0.0)
    smears = grid.at(points)
    length, sigma = smears.length_px.astype(float), np.maximum(smears.sigma_px.astype(float), TINY_SIGMA_PX)
    ends = smear_ends(points, smears.displacement * estimate.blur.kind.of_camera)  # else a smear is an error
    sampson = used.shared.sampson_px(length, across_px(length, smears.sigma_rad.astype(float)))
    order = end_order(geometry, used.ends, used.sampson_px, estimate.camera, grid.size)
    second_end_is_open = order.second_end_is_open(ends, sampson)
    usable = inside & (sigma <= np.maximum(MAX_SIGMA_SHARE * length, ALLOWED_SIGMA_PX))
    usable &= geometry.F is not None or geometry.H is not None
    fits = usable  # without F all are taken to follow H
    if geometry.F is not None:
        errors = serrmin(geometry.F, order.camera.undistorted(ends))
        fits = usable & (errors < (options or EstimatorOptions()).tolerance_px(length, sampson) ** 2)
    still = np.where(np.isfinite(keypoints), keypoints, 0.0)
    first, last = (np.where(inside[:, None], end, still) for end in open_and_close(ends, second_end_is_open))
    return replace(
        views_of(name, estimate),
        points_open=first,
        points_close=last,
        sampson_px=sampson,
        geometry=replace(geometry, inlier_mask=fits, second_end_is_open=second_end_is_open),
        usable=usable,
    )


def half_geometry(geometry: TwoViewGeometry, camera: Camera | None, size: tuple[int, int]) -> TwoViewGeometry:
    """Return the geometry from mid exposure (1) to close (2), given that from open (1) to close (2); no H.

    The camera is taken to move as one screw motion, and a photograph's features to lie in the middle of
    their smears. With a camera F is exactly that of the halved pose. ``size`` is width and height, pixels.
    """
    whole = geometry.cam2_from_cam1
    pose = None if whole is None else half_pose(whole)
    F = None if geometry.F is None else half_fundamental(geometry.F, size)
    if pose is not None and pose.translation.any() and camera is not None and F is not None:
        F = fundamental_from_pose(camera.K, pose.rotation, pose.translation)
    return replace(geometry, F=F, H=None, cam2_from_cam1=pose, covariance=None)


def half_pose(pose: RigidTransform) -> RigidTransform:
    """Return the pose, of unit translation, that applied twice is this one: of R^2 and (R + I) t."""
    R = rotation_matrix(0.5 * pose.rotation_vector)
    t = np.asarray(np.linalg.solve(R + np.eye(3), pose.translation), np.float64)
    return RigidTransform(rotation=R, translation=t / max(float(np.linalg.norm(t)), TINY))


def half_fundamental(F: Array, size: tuple[int, int]) -> Array:
    """Return F (3, 3) of half the motion, to first order in the motion; of unit norm and rank 2.

    A smear d about p satisfies p^T S p + a . (d x p) = 0 up to second order, F = S + [a]x; d/2 satisfies
    that of S / 2 + [a]x. Of rank 2 is the nearest matrix where the picture has unit size.
    """
    scale = 2.0 / max(size)
    T = np.diag([scale, scale, 1.0])
    T[:2, 2] = -scale * (np.array(size, float) - 1) / 2
    back = np.linalg.inv(T)
    S, a = symmetric_skew(back.T @ F @ back)
    U, singular, Vt = np.linalg.svd(0.5 * S + cross_matrix(a))
    return unit_norm(T.T @ (U * [singular[0], singular[1], 0.0]) @ Vt @ T)


def share_in_front(views: ExposureViews) -> float:
    """Return the share of inliers in front of both cameras (cheirality); 0 without a translation."""
    inliers, camera, pose = views.geometry.inlier_mask, views.camera, views.geometry.cam2_from_cam1
    if pose is None or not pose.translation.any() or camera is None or not inliers.any():
        return 0.0
    rays = (camera.rays(points[inliers]) for points in (views.points_open, views.points_close))
    return float(before_both(pose, *rays).mean())


def other_translation(views: ExposureViews) -> ExposureViews | None:
    """Return the views with the translation reversed, the rotation kept; None without F or a translation."""
    geometry = views.geometry
    if geometry.F is None:
        return None
    ends = np.stack([views.points_open, views.points_close], axis=1)
    order = end_order(geometry, ends, views.sampson_px, views.camera, views.size)
    if order.pose is None or not order.pose.translation.any():
        return None
    pose = RigidTransform(rotation=order.pose.rotation, translation=-order.pose.translation)
    exchanged = replace(order, pose=pose).second_end_is_open(ends, views.sampson_px)
    points_open, points_close = open_and_close(ends, exchanged)
    covariance = geometry.covariance
    other = replace(
        geometry,
        cam2_from_cam1=None if geometry.cam2_from_cam1 is None else pose,
        covariance=None if covariance is None else replace(covariance, tangents=-covariance.tangents),
        second_end_is_open=geometry.second_end_is_open ^ exchanged,
    )
    return replace(views, points_open=points_open, points_close=points_close, geometry=other)
