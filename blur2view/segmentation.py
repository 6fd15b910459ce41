"""Motion masks: which pixels move by themselves, given the camera's own motion."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.epipolar import Array, serrmin
from blur2view.matches import GridSmears
from blur2view.pipeline import Estimate
from blur2view.smear import smear_ends, upsample_grid

STRIDE = 4
CHI_SQUARE = 9.0


class MotionLabel(IntEnum):
    """What a pixel of a motion mask shows."""

    STATIC = 0
    MOVING = 1
    UNOBSERVABLE = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingRegion:
    """One connected part of a photograph that moves by itself.

    Parameters
    ----------
    area_px : int
        Its pixels.
    box : (int, int, int, int)
        Left, top, width and height, pixels.
    centroid : (float, float)
        (x, y), pixels.
    score : float
        Mean of the mask's score over it.
    F, H : ndarray of shape (3, 3) or None
        With ``SegmentOptions.objects``: two-view geometry of its own smears, as in ``TwoViewGeometry``.
    reason : str
        How F or H came about, or why there is neither; empty where it was not asked for.
    """

    area_px: int
    box: tuple[int, int, int, int]
    centroid: tuple[float, float]
    score: float
    F: Array | None = None
    H: Array | None = None
    reason: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionMask:
    """Which pixels move by themselves.

    Parameters
    ----------
    labels : ndarray of shape (H, W), uint8
        `MotionLabel`: 0 static, 1 moving, 2 unobservable.
    probability : ndarray of shape (H, W), float32
        That a pixel moves, after regularisation; in [0, 1].
    score : ndarray of shape (H, W), float32
        Squared residual over its variance (chi-square with one degree of freedom where nothing moves).
    regions : tuple of MovingRegion
        The connected moving parts, largest first.
    reason : str
        What the score was measured against.
    """

    labels: NDArray[np.uint8]
    probability: NDArray[np.float32]
    score: NDArray[np.float32]
    regions: tuple[MovingRegion, ...]
    reason: str


@dataclass(frozen=True, kw_only=True)
class SegmentOptions:
    """How moving parts are found: ``objects`` fits a motion of its own to each."""

    objects: bool = False


def segment(
    found: Estimate, image: NDArray[np.float32] | None = None, options: SegmentOptions | None = None
) -> MotionMask:
    """Tell pixels that move by themselves from those that the camera's motion explains.

    Parameters
    ----------
    found : Estimate
    image : ndarray of shape (H, W, 3), float32, optional
        The photograph; with it the mask follows its edges.
    options : SegmentOptions, optional

    Returns
    -------
    MotionMask
    """
    grid = GridSmears.of(found.field)
    rows, cols = (len(range(min(1, side - 1), side, STRIDE)) for side in found.field.shape)
    ends, sigma = smear_ends(grid.points, grid.displacement), 0.5**0.5 * grid.sigma_px
    if found.geometry.F is not None:
        residual, reason = serrmin(found.geometry.F, ends), "F of the camera's motion"
    else:
        residual, reason = 0.5 * grid.length_px**2, "a camera that does not move"
    scale = max(float(np.median(np.sqrt(residual) / sigma)) / 0.6745, 1e-3)
    score = (residual / (scale * sigma) ** 2).reshape(rows, cols).astype(np.float32)
    smooth = cv2.GaussianBlur(np.minimum(score, 25), (0, 0), 3)
    probability = 1 / (1 + np.exp(CHI_SQUARE / 2 - smooth))
    full = _to_pixels(probability, found.field.shape)
    labels = (full > 0.5).astype(np.uint8)
    score_px = _to_pixels(score, found.field.shape)
    return MotionMask(
        labels=labels,
        probability=full,
        score=score_px,
        regions=_regions(labels, score_px),
        reason=reason,
    )


def _to_pixels(grid: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float32]:
    """Resample a grid (h, w) to the pixels (H, W)."""
    large = upsample_grid(grid[..., None], STRIDE)[: shape[0], : shape[1], 0]
    missing = [(0, side - have) for side, have in zip(shape, large.shape, strict=True)]
    return np.pad(large, missing, mode="edge")


def _regions(labels: NDArray[np.uint8], score: NDArray[np.float32]) -> tuple[MovingRegion, ...]:
    """Describe the connected moving parts, largest first."""
    moving = (labels == MotionLabel.MOVING).astype(np.uint8)
    _, part, stats, centres = cv2.connectedComponentsWithStats(moving, connectivity=4)
    total = np.bincount(part.ravel(), weights=score.ravel())
    order = 1 + np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")
    return tuple(
        MovingRegion(
            area_px=int(stats[k, cv2.CC_STAT_AREA]),
            box=(int(stats[k, 0]), int(stats[k, 1]), int(stats[k, 2]), int(stats[k, 3])),
            centroid=(float(centres[k, 0]), float(centres[k, 1])),
            score=float(total[k] / stats[k, cv2.CC_STAT_AREA]),
        )
        for k in order
    )
