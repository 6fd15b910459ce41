"""One photograph as two virtual images: the scene as seen at shutter-open and at shutter-close."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera import Camera
from blur2view.geometry.epipolar import serrmin
from blur2view.geometry.pose import RigidTransform, before_both
from blur2view.geometry.two_view_geometry import TimeDirection, TwoViewGeometry
from blur2view.pipeline import Estimate
from blur2view.smears.grid import smear_ends
from blur2view.smears.matches import TINY_SIGMA_PX
from blur2view.smears.noise import across_px, sampson_px
from blur2view.two_view.estimate import EstimatorOptions
from blur2view.two_view.order import end_order, open_and_close

OPEN, CLOSE = "#open", "#close"  # what is appended to a photograph's name
# Of the smear's length: its direction is known. A limit in pixels as well (8) left 3 to 15 features of
# frames with smears of 16 to 20 px, where there are 900 about as exact for their length: with it 22 of 28
# views of a rendered video were mapped, 91 % of the exposures the right way in time, without all and 100 %.
MAX_SIGMA_SHARE = 0.5
STILL_PX = 1.5  # as short as that a smear need not be known better


@dataclass(frozen=True, kw_only=True, eq=False)
class ExposureViews:
    """Two virtual images of one photograph: both ends (N, 2), pixels, of smears, one scene point each."""

    name: str  # of the photograph, as the database names it
    size: tuple[int, int]  # width and height, pixels
    points_open: Array  # (N, 2)
    points_close: Array  # (N, 2)
    sampson_px: Array  # (N,) standard deviations of Sampson distances, as of `SmearMatches`
    geometry: TwoViewGeometry  # from open (1) to close (2)
    camera: Camera | None  # known intrinsics, or approximate ones; None leaves them to COLMAP's default
    time: TimeDirection = field(default_factory=TimeDirection)
    usable: NDArray[np.bool_] | None = None  # (N,) points that are matched; None: all, where F or H is known
    smear_px: float | None = None  # length of the photograph's smear, 0 of a camera that did not move

    @property
    def names(self) -> tuple[str, str]:
        """Return the names of both images: the photograph's with "#open" and "#close" appended."""
        return self.name + OPEN, self.name + CLOSE

    def reversed(self) -> Self:
        """Return the views under time reversal: ends exchanged, F and E transposed, the pose inverted."""
        first, last, geometry = self.points_close, self.points_open, self.geometry.reversed()
        return replace(self, points_open=first, points_close=last, geometry=geometry)


def views_of(name: str, estimate: Estimate) -> ExposureViews:
    """Return both virtual images of an estimate, in its order of time; ValueError of a rolling shutter."""
    if estimate.shutter is not None:
        raise ValueError("views are of the ends as recorded: estimate without a shutter")
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
    """Return the features (N, 2), pixels, of a photograph of this name moved to both ends of the exposure.

    Where the camera did not move they stay. Usable are those within the picture whose smear is known well
    enough; what is not finite is put at 0.
    """
    grid, geometry = estimate.grid, estimate.geometry
    keypoints = np.asarray(keypoints, float)
    within = (keypoints >= -0.5) & (keypoints < np.array(grid.size) - 0.5)  # False of NaN
    inside: NDArray[np.bool_] = np.all(within, axis=1)
    points = np.where(inside[:, None], keypoints, 0.0)
    smears = grid.at(points)
    length, sigma = smears.length_px.astype(float), np.maximum(smears.sigma_px.astype(float), TINY_SIGMA_PX)
    moves = estimate.blur.kind.of_camera  # else a smear is its error
    ends = smear_ends(points, smears.displacement * moves)
    across = across_px(length, smears.sigma_rad.astype(float))
    sampson = sampson_px(length, across, estimate.matches.shared)
    used = estimate.matches
    order = end_order(geometry, used.ends, used.sampson_px, estimate.camera, grid.size)
    second_end_is_open = order.second_end_is_open(ends, sampson)
    first, last = open_and_close(ends, second_end_is_open)
    certain = sigma <= np.maximum(MAX_SIGMA_SHARE * length, STILL_PX)
    usable = inside & certain & (geometry.F is not None or geometry.H is not None)
    fits = usable  # without F all are taken to follow H
    if geometry.F is not None:
        errors = serrmin(geometry.F, order.camera.undistorted(ends))
        fits = usable & (errors < (options or EstimatorOptions()).tolerance_px(length, sampson) ** 2)
    moved, still = inside[:, None], np.where(np.isfinite(keypoints), keypoints, 0.0)
    return replace(
        views_of(name, estimate),
        points_open=np.where(moved, first, still),
        points_close=np.where(moved, last, still),
        sampson_px=sampson,
        geometry=replace(geometry, inlier_mask=fits, second_end_is_open=second_end_is_open),
        usable=usable,
    )


def share_in_front(views: ExposureViews) -> float:
    """Return the share of the inliers in front of both cameras (cheirality); 0 without a translation."""
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
        covariance=covariance and replace(covariance, tangents=-covariance.tangents),
        second_end_is_open=geometry.second_end_is_open ^ exchanged,
    )
    return replace(views, points_open=points_open, points_close=points_close, geometry=other)
