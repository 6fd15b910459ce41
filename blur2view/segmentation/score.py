"""How much each smear contradicts the camera's motion, on the network's grid.

The score is a squared residual over the variance that the smear states. Against F the residual is the Sampson
distance of the better order, whose error is that of the smear's direction; against a homography the end-point
error; of a still camera the length of the smear itself. The residuals of most smears, which are static ones,
tell how much larger the errors are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.geometry.epipolar import homogeneous
from blur2view.geometry.sampson import serrmin
from blur2view.pipeline import Estimate
from blur2view.smears.field import smear_ends
from blur2view.smears.selection import GridSmears, grid_pixels

# Quantile 0.6 of an error along one axis, and of one along both together, in standard deviations: the scale
# holds while at most 40 % of the smears move.
HALF_NORMAL_60, RAYLEIGH_60 = 0.8416, 0.9572
# Error that no sigma tells. With 0.2, 0.3, 0.5 and 1 px masks of true smears have an IoU of 0.80, 0.77, 0.75
# and 0.70 over all pixels of 48 development scenes; with 0.2 px the network's call 0.6 % of a street moving.
FLOOR_PX = 0.3
STILL_FLOOR_PX = 0.75  # of lengths before a still camera: on sharp photographs their median is 0.3 to 0.6 px
SIGHT_PX = 6.0  # length of a smear that must differ from none where nothing else moves
STILL_SHARE = 0.5  # of the measurable image without smears from which the camera stands still
MEDIAN_RAYLEIGH = 1.1774


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionScore:
    """Scores on the network's grid.

    Parameters
    ----------
    score : ndarray of shape (h, w)
        Squared residual over its variance.
    reach : ndarray of shape (h, w)
        The score that a smear of this length and certainty would have if it ran across what the camera's
        motion predicts: where that is small the smear says nothing.
    reason : str
        What the score was measured against.
    error_scale : float
        The errors of most smears over their stated ones.
    greatest : ndarray of shape (h, w)
        The greatest score against any of the motions that the camera may have had; ``score`` is the least.
    """

    score: Array
    reach: Array
    reason: str
    error_scale: float
    greatest: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class _Grid:
    """The smears that are judged: ends (N, 2, 2), lengths and standard deviations (N,), pixels.

    Ends are NaN where a distorted camera has no rays; then so are residuals against F and H.
    """

    ends: Array
    length_px: Array
    across_px: Array
    whole_px: Array

    @classmethod
    def of(cls, found: Estimate) -> _Grid:
        smears = GridSmears.of(found.field)
        ends = measured_ends(smears, found.camera)
        across = 0.5**0.5 * smears.sigma_px if smears.across_px is None else smears.across_px
        return cls(ends=ends, length_px=smears.length_px, across_px=across, whole_px=smears.sigma_px)


def motion_score(found: Estimate) -> MotionScore:
    """Score the smears of an estimate against the motion of the camera that it holds, at their stated errors.

    Without F, homography or a still camera there is nothing to measure against, and reach is zero.
    """
    grid, geometry, scale = _Grid.of(found), found.geometry, 1.0
    if geometry.F is not None:
        residual, reach, scale = _against_F(grid, geometry.F)
        reason = "measured by the distance from the epipolar lines of the camera's F"
    elif geometry.H is not None:
        residual, reach, scale = _against_H(grid, geometry.H)
        reason = "measured by the error against the camera's homography"
    elif found.matches.still_share >= STILL_SHARE:
        residual, reach = _against_stillness(grid)
        share = f"{int(100 * found.matches.still_share)}% of what can be measured shows no smear"
        reason = f"the camera stands still ({share}): measured by the smears' length"
    else:
        residual = reach = np.zeros(len(grid.ends))
        reason = f"nothing to measure against: {geometry.reason}"
    reach = np.maximum(residual, reach)  # what is seen to move can be seen
    residual, reach = (np.where(np.isnan(value), 0.0, value) for value in (residual, reach))  # without rays
    score, reach = (np.reshape(value**2, grid_shape(found.field.shape)) for value in (residual, reach))
    return MotionScore(score=score, reach=reach, reason=reason, error_scale=scale, greatest=score)


def _against_F(grid: _Grid, F: Array) -> tuple[Array, Array, float]:
    """Sampson distances, and those of smears turned by 90 degrees, in standard deviations; their scale."""
    residual, turned = np.sqrt(serrmin(F, grid.ends)), np.sqrt(serrmin(F, turned_ends(grid.ends)))
    sigma = np.hypot(0.5**0.5 * grid.across_px, FLOOR_PX)  # an end has half of the error, and F meets both
    return residual / sigma, turned / sigma, _quantile_60(residual / sigma) / HALF_NORMAL_60


def _against_H(grid: _Grid, H: Array) -> tuple[Array, Array, float]:
    """Differences from a homography's displacements, the largest possible, in sigmas, and their scale."""
    predicted = displacement_of(H, grid.ends.mean(axis=1))
    seen = grid.ends[:, 1] - grid.ends[:, 0]
    error = np.minimum(*(np.linalg.norm(seen - sign * predicted, axis=1) for sign in (1, -1)))
    sigma = np.hypot(grid.whole_px, FLOOR_PX)
    reach = np.maximum(2**0.5 * np.linalg.norm(predicted, axis=1), SIGHT_PX)
    return error / sigma, reach / sigma, _quantile_60(error / sigma) / RAYLEIGH_60


def _against_stillness(grid: _Grid) -> tuple[Array, Array]:
    """Lengths, and the length that must be seen, in standard deviations."""
    sigma = max(float(np.median(grid.length_px)) / MEDIAN_RAYLEIGH, STILL_FLOOR_PX)
    blind = grid.whole_px > np.maximum(grid.length_px, SIGHT_PX)
    return grid.length_px / sigma, np.where(blind, 0.0, SIGHT_PX / sigma)


def _quantile_60(ratio: Array) -> float:
    """Return the quantile 0.6 of residuals (N,) in standard deviations; NaN, without rays, is left out."""
    known = ratio[np.isfinite(ratio)]
    return float(np.quantile(known, 0.6)) if len(known) else 1.0


def turned_ends(ends: Array) -> Array:
    """Turn smears (N, 2, 2) by 90 degrees about their midpoints."""
    middle, half = ends.mean(axis=1), 0.5 * (ends[:, 1] - ends[:, 0])
    turned = np.stack([-half[:, 1], half[:, 0]], axis=1)
    return np.stack([middle - turned, middle + turned], axis=1)


def displacement_of(H: Array, middle: Array) -> Array:
    """Displacements (N, 2) of the scene points that a homography H (3, 3) has at ``middle`` at mid exposure.

    Half of the motion before, half after: ends that H maps on each other about the given midpoints, to
    second order.
    """
    forward, backward = (_mapped(M, middle) for M in (H, np.asarray(np.linalg.inv(H), float)))
    return 0.5 * (forward - backward)


def _mapped(H: Array, points: Array) -> Array:
    """Points (N, 2) under a homography."""
    mapped = homogeneous(points) @ H.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def measured_ends(smears: GridSmears, camera: Camera | None) -> Array:
    """Return the ends (N, 2, 2) as the camera's undistorted picture shows them, which F and H are of."""
    ends = smear_ends(smears.points, smears.displacement)
    if camera is None or not camera.distorted:
        return ends
    return camera.undistorted(ends)


def grid_shape(shape: tuple[int, int]) -> tuple[int, int]:
    """Count the rows and columns of `GridSmears` for a field (H, W)."""
    rows, columns = grid_pixels(shape)
    return len(np.unique(rows)), len(np.unique(columns))
