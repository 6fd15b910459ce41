"""One photograph as two virtual images: the scene as seen at shutter-open and at shutter-close."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.exposure.end_order import motion_order, open_and_close
from blur2view.geometry.pose import RigidTransform, before_both
from blur2view.geometry.two_view_geometry import TimeDirection, TwoViewGeometry
from blur2view.pipeline import Estimate
from blur2view.smears.matches import SmearMatches
from blur2view.smears.noise import INDEPENDENT, SharedErrors
from blur2view.smears.selection import LEAST_SIGMA_PX

OPEN, CLOSE = "#open", "#close"  # what is appended to a photograph's name


@dataclass(frozen=True, kw_only=True, eq=False)
class ExposureViews:
    """Two virtual images of one photograph.

    Parameters
    ----------
    name : str
        Of the photograph, as the database names it ("a.jpg", "left/a.jpg").
    size : (int, int)
        Width and height, pixels.
    points_open, points_close : ndarray of shape (N, 2)
        Both ends of the N used smears, pixels (0, 0 at the centre of the top-left one), index-aligned: one
        scene point each, as seen at shutter-open and at shutter-close.
    sigma_px : ndarray of shape (N,)
        Standard deviation of points_close - points_open.
    geometry : TwoViewGeometry
        From open (1) to close (2): ``points_close^T F points_open = 0``.
    camera : Camera or None
        Known intrinsics, or approximate ones from EXIF; None leaves them to COLMAP's default.
    time : TimeDirection
        Unknown, and so arbitrary, by default.
    usable : ndarray of bool, shape (N,), or None
        Points that are matched; None: all, where F or H is known.
    across_px : ndarray of shape (N,) or None
        Standard deviation of the part of points_close - points_open across itself, as of `SmearMatches`.
    shared : SharedErrors
        What the errors have in common.

    Raises
    ------
    ValueError
        If shapes or values are not as above.
    """

    name: str
    size: tuple[int, int]
    points_open: Array
    points_close: Array
    sigma_px: Array
    geometry: TwoViewGeometry
    camera: Camera | None
    time: TimeDirection = field(default_factory=TimeDirection)
    usable: NDArray[np.bool_] | None = None
    across_px: Array | None = None
    shared: SharedErrors = INDEPENDENT

    def __post_init__(self) -> None:
        shapes = self.points_open.shape, self.points_close.shape, (*self.sigma_px.shape, 2)
        if len(set(shapes)) != 1 or self.points_open.ndim != 2:
            raise ValueError(f"expected points (N, 2) twice and sigma_px (N,), got {shapes}")
        if self.usable is not None and self.usable.shape != self.sigma_px.shape:
            raise ValueError(f"expected usable of shape {self.sigma_px.shape}, got {self.usable.shape}")
        if not np.isfinite([self.points_open, self.points_close]).all():
            raise ValueError("points must be finite")
        if not self.name or min(self.size) < 1:
            raise ValueError(f"need a name and a positive size, got {self.name!r} and {self.size}")

    @property
    def names(self) -> tuple[str, str]:
        """Return the names of both images: the photograph's with "#open" and "#close" appended.

        No file has these names. They sort beside their photograph and yield its name when cut at the last
        "#", which COLMAP's text formats take for a comment only where a line begins with it. A photograph
        that itself ends in "#open" would collide; writers refuse an image of such a name that is not theirs.
        """
        return self.name + OPEN, self.name + CLOSE

    def reversed(self) -> Self:
        """Return the views under time reversal: ends exchanged, F and E transposed, the pose inverted."""
        return replace(
            self,
            points_open=self.points_close,
            points_close=self.points_open,
            geometry=self.geometry.reversed(),
        )


def views_of(name: str, estimate: Estimate) -> ExposureViews:
    """Return both virtual images of an estimate, in the time direction that the estimator happened to choose.

    Parameters
    ----------
    name : str
        Of the photograph, as the database is to name it.
    estimate : Estimate
        Also one without F: then the order of the ends is arbitrary. With F every smear's order is decided by
        F and by cheirality (`end_order`), and ``geometry.swapped`` is that order.

    Raises
    ------
    ValueError
        If the estimate has a rolling shutter: its F is not that of the ends as recorded, and no camera
        of one time saw the points of all rows where they are.
    """
    if estimate.shutter is not None:
        raise ValueError("views are of the ends as recorded: estimate without a shutter")
    order = motion_order(estimate.geometry, estimate.matches, estimate.camera, estimate.grid.size)
    return views_in_order(name, estimate, order.swapped(estimate.matches.ends, estimate.matches.sampson_px))


def views_in_order(name: str, estimate: Estimate, swapped: NDArray[np.bool_]) -> ExposureViews:
    """Return both virtual images of an estimate whose ends[:, 1] are open where ``swapped`` (N,)."""
    points_open, points_close = open_and_close(estimate.matches.ends, swapped)
    return ExposureViews(
        name=name,
        size=estimate.grid.size,
        points_open=points_open,
        points_close=points_close,
        sigma_px=estimate.matches.sigma_px,
        across_px=estimate.matches.across_px,
        shared=estimate.matches.shared,
        geometry=replace(estimate.geometry, swapped=swapped),
        camera=estimate.camera,
        time=estimate.time,
    )


def share_in_front(views: ExposureViews) -> float:
    """Return the share of the inliers in front of both cameras (cheirality); 0 without a translation."""
    geometry, camera, pose = views.geometry, views.camera, views.geometry.cam2_from_cam1
    if pose is None or not pose.translation.any() or camera is None or not geometry.inlier_mask.any():
        return 0.0
    rays = (camera.rays(points[geometry.inlier_mask]) for points in (views.points_open, views.points_close))
    return float(before_both(pose, *rays).mean())


def other_translation(views: ExposureViews) -> ExposureViews | None:
    """Return the views with the translation reversed and the rotation kept: smears are ordered anew.

    None without F, and where the pose is a rotation alone. Both have the same F and E, which fix the
    translation but for its sign.
    """
    geometry = views.geometry
    if geometry.F is None:
        return None
    ends = np.stack([views.points_open, views.points_close], axis=1)
    sigma_px = np.maximum(views.sigma_px, LEAST_SIGMA_PX)
    matches = SmearMatches(ends=ends, sigma_px=sigma_px, shared=views.shared)
    if views.across_px is not None:
        matches = replace(matches, across_px=views.across_px)
    order = motion_order(geometry, matches, views.camera, views.size)
    if order.pose is None or not order.pose.translation.any():
        return None
    pose = RigidTransform(rotation=order.pose.rotation, translation=-order.pose.translation)
    swapped = replace(order, pose=pose).swapped(ends, matches.sampson_px)
    known, covariance = geometry.cam2_from_cam1, geometry.covariance
    if known is not None and known.translation.any():
        known = pose
    if covariance is not None:
        covariance = replace(covariance, tangents=-covariance.tangents)
    points_open, points_close = open_and_close(ends, swapped)
    return replace(
        views,
        points_open=points_open,
        points_close=points_close,
        geometry=replace(
            geometry,
            E=None if geometry.E is None else -geometry.E,
            cam2_from_cam1=known,
            covariance=covariance,
            swapped=geometry.swapped ^ swapped,
        ),
    )
