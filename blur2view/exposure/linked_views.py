"""Both virtual images of a photograph with known features: each feature moved by half of its smear.

So a track that holds the feature holds both ends of its smear, and the virtual views join a reconstruction
through the photograph's own matches.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.exposure.end_order import MotionOrder, motion_order
from blur2view.exposure.views import ExposureViews, views_of
from blur2view.geometry.sampson import serrmin
from blur2view.pipeline import Estimate
from blur2view.smears.field import SmearField, smear_ends
from blur2view.smears.matches import SmearMatches
from blur2view.smears.sampling import error_across
from blur2view.two_view.options import EstimatorOptions

# Of the smear's length: its direction is known. A limit in pixels as well (8) left 3 to 15 features of
# frames with smears of 16 to 20 px, where there are 900 about as exact for their length: with it 22 of 28
# views of a rendered video were mapped, 91 % of the exposures the right way in time, without all and 100 %.
MAX_SIGMA_SHARE = 0.5
STILL_PX = 1.5  # as short as that a smear need not be known better


@dataclass(frozen=True, kw_only=True, eq=False)
class KeypointViews:
    """Virtual images whose points are the photograph's features, moved.

    Parameters
    ----------
    views : ExposureViews
        Of N points, index-aligned with the features; the geometry's inlier_mask has N entries too.
    usable : ndarray of bool, shape (N,)
        Features whose smear is known well enough; only these are matched.
    """

    views: ExposureViews
    usable: NDArray[np.bool_]


def keypoint_views(
    name: str, keypoints: Array, estimate: Estimate, options: EstimatorOptions | None = None
) -> KeypointViews:
    """Return the features (N, 2), pixels, of a photograph of this name moved to both ends of the exposure.

    What lies beyond the picture stays where it is and is not usable; what is not finite is put at 0.
    ``options`` are those of the estimate: what counts as an inlier.
    """
    options = options or EstimatorOptions()
    geometry, sampled = estimate.geometry, sample(estimate.field, keypoints)
    size = (estimate.field.shape[1], estimate.field.shape[0])
    ends = smear_ends(np.where(sampled.inside[:, None], keypoints, 0.0), sampled.displacement)
    order = motion_order(geometry, estimate.matches.weighed_across(), estimate.camera, size)
    swapped = order.swapped(ends, sampled.weighed_px(estimate.matches))
    index = np.arange(len(ends))
    first, last = ends[index, swapped.astype(int)], ends[index, 1 - swapped.astype(int)]
    known = geometry.F is not None or geometry.H is not None
    usable = sampled.certain & known
    fits = usable & _fits(order, ends, sampled.weighed_px(estimate.matches), options)
    moved, still = sampled.inside[:, None], np.where(np.isfinite(keypoints), keypoints, 0.0)
    views = replace(
        views_of(name, estimate),
        points_open=np.where(moved, first, still),
        points_close=np.where(moved, last, still),
        sigma_px=sampled.sigma_px,
        geometry=replace(geometry, inlier_mask=fits, swapped=swapped),
    )
    return KeypointViews(views=views, usable=usable)


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledSmears:
    """Smears (N) of a field at any pixels; zero, and not inside, beyond it."""

    displacement: Array
    sigma_px: Array
    inside: NDArray[np.bool_]
    sigma_rad: Array | None = None

    def weighed_px(self, matches: SmearMatches) -> Array:
        """Return the standard deviations (N,) as the estimator weights those of its matches, pixels."""
        if self.sigma_rad is None or matches.across_px is None:
            return self.sigma_px
        length = np.hypot(*self.displacement.T)
        return matches.across_scale * error_across(length, self.sigma_rad)

    @property
    def certain(self) -> NDArray[np.bool_]:
        """Return where sigma is small relative to the smear's length, or small itself, (N,) bool."""
        allowed = np.maximum(MAX_SIGMA_SHARE * np.hypot(*self.displacement.T), STILL_PX)
        return np.asarray(self.inside & (self.sigma_px <= allowed))


def sample(field: SmearField, points: Array) -> SampledSmears:
    """Return a field at the pixels nearest to points (N, 2); it is smooth over the four pixels of a cell."""
    height, width = field.shape
    finite = np.asarray(np.isfinite(points).all(axis=1), bool)
    nearest = np.rint(np.where(finite[:, None], np.clip(points, -1e9, 1e9), -1.0)).astype(np.int64)
    inside = np.asarray(finite & ((nearest >= 0) & (nearest < [width, height])).all(axis=1), bool)
    cols, rows = np.where(inside[:, None], nearest, 0).T
    displacement = np.where(inside[:, None], field.displacement[rows, cols], 0.0).astype(np.float64)
    sigma = np.maximum(field.sigma_px[rows, cols].astype(np.float64), 1e-3)
    angle = None if field.sigma_rad is None else field.sigma_rad[rows, cols].astype(np.float64)
    return SampledSmears(displacement=displacement, sigma_px=sigma, inside=inside, sigma_rad=angle)


def _fits(order: MotionOrder, ends: Array, sigma_px: Array, options: EstimatorOptions) -> NDArray[np.bool_]:
    """Return which smears are within the estimator's tolerance of F; without F all are taken to follow H."""
    F = order.geometry.F
    if F is None:
        return np.ones(len(ends), bool)
    tolerance_px = options.tolerance_px(sigma_px)
    return np.asarray(serrmin(F, order.camera.undistorted(ends)) < tolerance_px**2)
