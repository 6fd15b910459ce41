"""Both virtual images of a photograph with known features: each feature moved by half of its smear.

So a track that holds the feature holds both ends of its smear, and the virtual views join a reconstruction
through the photograph's own matches.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.exposure.end_order import motion_order, open_and_close
from blur2view.exposure.views import ExposureViews, views_of
from blur2view.geometry.sampson import serrmin
from blur2view.pipeline import Estimate
from blur2view.smears.field import smear_ends
from blur2view.smears.noise import across_px, sampson_px
from blur2view.smears.selection import LEAST_SIGMA_PX
from blur2view.two_view.options import EstimatorOptions

# Of the smear's length: its direction is known. A limit in pixels as well (8) left 3 to 15 features of
# frames with smears of 16 to 20 px, where there are 900 about as exact for their length: with it 22 of 28
# views of a rendered video were mapped, 91 % of the exposures the right way in time, without all and 100 %.
MAX_SIGMA_SHARE = 0.5
STILL_PX = 1.5  # as short as that a smear need not be known better


def keypoint_views(
    name: str,
    keypoints: Array,
    estimate: Estimate,
    options: EstimatorOptions | None = None,
    excluded: NDArray[np.bool_] | None = None,
) -> ExposureViews:
    """Return the features (N, 2), pixels, of a photograph of this name moved to both ends of the exposure.

    Usable are those whose smear is known well enough. What lies beyond the picture stays where it is and is
    not usable; what is not finite is put at 0. Nor is usable what lies on pixels (H, W) that are
    ``excluded``, as they move by themselves. ``options`` are those of the estimate: what counts as an inlier.
    """
    options = options or EstimatorOptions()
    grid, geometry = estimate.grid, estimate.geometry
    keypoints = np.asarray(keypoints, float)
    within = np.isfinite(keypoints) & (keypoints >= -0.5) & (keypoints < np.array(grid.size) - 0.5)
    inside: NDArray[np.bool_] = np.all(within, axis=1)
    points = np.where(inside[:, None], keypoints, 0.0)
    smears = grid.at(points)
    length, sigma = smears.length_px.astype(float), np.maximum(smears.sigma_px.astype(float), LEAST_SIGMA_PX)
    ends = smear_ends(points, smears.displacement)
    across = across_px(length, smears.sigma_rad.astype(float))
    sampson = sampson_px(length, across, estimate.matches.shared)
    order = motion_order(geometry, estimate.matches, estimate.camera, grid.size)
    swapped = order.swapped(ends, sampson)
    first, last = open_and_close(ends, swapped)
    certain = sigma <= np.maximum(MAX_SIGMA_SHARE * length, STILL_PX)
    usable = inside & certain & (geometry.F is not None or geometry.H is not None)
    if excluded is not None:
        columns, rows = np.rint(points).astype(int).T
        usable &= ~excluded[rows, columns]
    fits = usable  # without F all are taken to follow H
    if geometry.F is not None:
        errors = serrmin(geometry.F, order.camera.undistorted(ends))
        fits = usable & (errors < options.tolerance_px(length, sampson) ** 2)
    moved, still = inside[:, None], np.where(np.isfinite(keypoints), keypoints, 0.0)
    return replace(
        views_of(name, estimate),
        points_open=np.where(moved, first, still),
        points_close=np.where(moved, last, still),
        sigma_px=sigma,
        across_px=across,
        geometry=replace(geometry, inlier_mask=fits, swapped=swapped),
        usable=usable,
    )
