"""One photograph as two virtual images: the scene as seen at shutter-open and at shutter-close."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.exposure.end_order import motion_order
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.pipeline import Estimate

OPEN, CLOSE = "#open", "#close"  # what is appended to a photograph's name


@dataclass(frozen=True, kw_only=True)
class TimeDirection:
    """Whether open and close mean what they say.

    Parameters
    ----------
    known : bool
        False: one of both flips of time was taken, no one knows whether the right one.
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
        """Check the confidence."""
        if not 0 <= self.confidence <= 1:
            raise ValueError(f"confidence must be in [0, 1], got {self.confidence}")


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
        Intrinsics that were given or hinted at; None leaves them to COLMAP's guess.
    time : TimeDirection
        Unknown, and so arbitrary, by default.

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

    def __post_init__(self) -> None:
        """Check shapes and values."""
        shapes = self.points_open.shape, self.points_close.shape, (*self.sigma_px.shape, 2)
        if len(set(shapes)) != 1 or self.points_open.ndim != 2:
            raise ValueError(f"expected points (N, 2) twice and sigma_px (N,), got {shapes}")
        if not np.isfinite([self.points_open, self.points_close]).all():
            raise ValueError("points must be finite")
        if not self.name or min(self.size) < 1:
            raise ValueError(f"need a name and a positive size, got {self.name!r} and {self.size}")

    @property
    def names(self) -> tuple[str, str]:
        """Names of both images: the photograph's with "#open" and "#close" appended.

        No file has these names, as no pixels exist that show these views. They sort beside their photograph
        and give its name by cutting at the last "#". COLMAP's text formats take a "#" for a comment only
        where a line begins with it, and an image's name begins with the photograph's. A photograph that
        itself ends in "#open" would collide; writers refuse an image of such a name that is not ours.
        """
        return self.name + OPEN, self.name + CLOSE

    def corrected(self) -> ExposureViews:
        """Move both ends of the inliers onto each other's epipolar lines, each by as little as possible.

        Then every bundle adjustment rests at our pose, without any error: unweighed, it would drift from it
        along what smears that err together tell badly. What COLMAP says of its precision is then empty; ours
        is in the geometry's covariance. Views without F stay as they are. Of a distorted camera to first
        order.

        References
        ----------
        Hartley and Sturm, Triangulation, CVIU 68(2), 1997.
        """
        F, kept = self.geometry.F, self.geometry.inlier_mask
        if F is None or not kept.any():
            return self
        given = np.stack([self.points_open[kept], self.points_close[kept]])
        pixels = given if self.camera is None else self.camera.undistorted(given)
        moved = np.stack(cv2.correctMatches(F, pixels[:1], pixels[1:]))[:, 0] - pixels
        told = np.isfinite(moved).all(axis=(0, 2), keepdims=True)
        ends = np.stack([self.points_open, self.points_close])
        ends[:, kept] = given + np.where(told, moved, 0.0)
        return replace(self, points_open=ends[0], points_close=ends[1])

    def reversed(self) -> ExposureViews:
        """Give the other flip of time: ends exchanged, F and E transposed, the pose inverted."""
        return replace(
            self,
            points_open=self.points_close,
            points_close=self.points_open,
            geometry=self.geometry.reversed(),
        )


def views_of(name: str, found: Estimate) -> ExposureViews:
    """Turn an estimate into both virtual images, in the flip of time that the estimator happened to choose.

    Parameters
    ----------
    name : str
        Of the photograph, as the database is to name it.
    found : Estimate
        Also one without F: then the order of the ends means nothing, and the geometry says so. With F every
        smear's order is decided by F and by depth (`end_order`), and ``geometry.swapped`` is that order.
    """
    ends = found.matches.ends
    height, width = found.field.shape
    weighed = found.matches.weighed_across()
    order = motion_order(found.geometry, weighed, found.camera, (width, height))
    swapped = order.swapped(ends, weighed.sigma_px)
    index = np.arange(len(ends))
    return ExposureViews(
        name=name,
        size=(width, height),
        points_open=ends[index, swapped.astype(int)],
        points_close=ends[index, 1 - swapped.astype(int)],
        sigma_px=found.matches.sigma_px,
        geometry=replace(found.geometry, swapped=swapped),
        camera=found.camera,
    )
