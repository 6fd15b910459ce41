"""Motion masks: which pixels move by themselves, given the camera's own motion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Array
from blur2view.geometry.two_view_geometry import Configuration
from blur2view.pipeline import Estimate
from blur2view.segmentation.admitted import admitted_motions, least_score
from blur2view.segmentation.object_motion import object_motion
from blur2view.segmentation.regions import decide, to_pixels
from blur2view.segmentation.score import MotionScore, motion_score
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.options import EstimatorOptions

STAYS, MOVES = 127 / 255, 128 / 255  # nearest to 0.5 on its two sides in a picture of 8 bits


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
    inside : (int, int)
        (x, y) of one of its pixels.
    config : Configuration or None
        With ``SegmentOptions.objects``: the configuration of its own smears.
    F, H : ndarray of shape (3, 3) or None
        Their two-view geometry, as in ``TwoViewGeometry``.
    reason : str
        How F or H came about, or why there is neither; empty where it was not asked for.
    """

    area_px: int
    box: tuple[int, int, int, int]
    centroid: tuple[float, float]
    score: float
    inside: tuple[int, int]
    config: Configuration | None = None
    F: Array | None = None
    H: Array | None = None
    reason: str = ""

    def of(self, moving: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return this part of the mask (H, W) that it is from."""
        _, part = cv2.connectedComponents(moving.astype(np.uint8), connectivity=4)
        return np.asarray(part == part[self.inside[1], self.inside[0]])


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionMask:
    """Which pixels move by themselves.

    Parameters
    ----------
    labels : ndarray of shape (H, W), uint8
        `MotionLabel`: 0 static, 1 moving, 2 unobservable.
    probability : ndarray of shape (H, W), float32
        That a pixel moves, after regularisation; in [0, 1], above 0.5 exactly where labels say moving. It
        grows with the evidence but is no frequency: fewer of those pixels move.
    score : ndarray of shape (H, W), float32
        Squared residual over its variance (chi-square where nothing moves: of one degree of freedom, of
        two before a still camera, where the squared length of a smear is measured); the least against all
        motions that the camera may have had.
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
    """What is asked for.

    ``splits`` how often the picture is divided into two random halves of its blocks: what moves must
    contradict their motions, too; with ``objects`` a motion of its own for every moving part; ``estimator``
    estimates all of these.
    """

    splits: int = 1
    objects: bool = False
    estimator: EstimatorOptions = field(default_factory=EstimatorOptions)

    def __post_init__(self) -> None:
        """Refuse a negative number of splits."""
        if self.splits < 0:
            raise ValueError(f"splits must not be negative, got {self.splits}")


def segment(
    found: Estimate,
    options: SegmentOptions | None = None,
    rng: np.random.Generator | None = None,
) -> MotionMask:
    """Return which pixels move by themselves and which the camera's motion explains.

    A part moves if its smears contradict the estimate's F or homography, and those of halves of the picture
    that explain as much; before a camera that stands still, if they are long. What only some of these motions
    explain is unobservable.

    Parameters
    ----------
    found : Estimate
        Of one photograph.
    options : SegmentOptions, optional
    rng : numpy.random.Generator, optional
        Divides the picture, estimates motions; ``default_rng(0)`` by default.

    Returns
    -------
    MotionMask
        All unobservable where nothing is known of the camera's motion, in the whole picture or in a half.
    """
    options, shape = options or SegmentOptions(), found.field.shape
    rng = np.random.default_rng(0) if rng is None else rng
    if found.shutter is not None:  # its geometry is not that of the smears as recorded
        recorded = estimate_two_view(found.matches, options.estimator, rng, found.camera)
        found = replace(found, geometry=recorded, shutter=None)
    scored = _scored(found, options, rng)
    cells = decide(scored)
    moving, seen = (to_pixels(mask, shape) >= 0.5 for mask in (cells.moving, cells.observable))
    labels = np.full(shape, MotionLabel.UNOBSERVABLE, np.uint8)
    labels[seen] = MotionLabel.STATIC
    labels[moving] = MotionLabel.MOVING
    regions = moving_regions(moving, score := to_pixels(scored.score, shape))
    if options.objects:
        regions = with_motions(found, moving, regions, options.estimator, rng)
    return MotionMask(
        labels=labels,
        probability=agreeing(to_pixels(cells.probability, shape), moving),
        score=score,
        regions=regions,
        reason=scored.reason,
    )


def _scored(found: Estimate, options: SegmentOptions, rng: np.random.Generator) -> MotionScore:
    """Return scores against all motions that the camera may have had."""
    if found.geometry.F is None and found.geometry.H is None:
        return motion_score(found)
    return least_score(found, admitted_motions(found, options.splits, options.estimator, rng))


def agreeing(probability: NDArray[np.float32], moving: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Bring probabilities (H, W) to the side of 0.5 that a mask (H, W) says, also in steps of 1 / 255."""
    agreed = np.where(moving, np.maximum(probability, MOVES), np.minimum(probability, STAYS))
    return agreed.astype(np.float32)


def with_motions(
    found: Estimate,
    moving: NDArray[np.bool_],
    regions: tuple[MovingRegion, ...],
    options: EstimatorOptions,
    rng: np.random.Generator,
) -> tuple[MovingRegion, ...]:
    """Fit a motion to every connected part of a mask (H, W)."""
    fitted = []
    for region in regions:
        own = object_motion(found, region.of(moving), options, rng)
        fitted.append(replace(region, config=own.config, F=own.F, H=own.H, reason=own.reason))
    return tuple(fitted)


def moving_regions(moving: NDArray[np.bool_], score: NDArray[np.float32]) -> tuple[MovingRegion, ...]:
    """Describe the connected parts of a mask (H, W), largest first."""
    count, part, stats, centres = cv2.connectedComponentsWithStats(moving.astype(np.uint8), connectivity=4)
    total = np.zeros(count)
    for row, values in zip(part, score, strict=True):  # at once it would take 16 bytes per pixel
        total += np.bincount(row, weights=values, minlength=count)
    order = 1 + np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")
    return tuple(
        MovingRegion(
            area_px=int(stats[k, cv2.CC_STAT_AREA]),
            box=(int(stats[k, 0]), int(stats[k, 1]), int(stats[k, 2]), int(stats[k, 3])),
            centroid=(float(centres[k, 0]), float(centres[k, 1])),
            score=float(total[k] / stats[k, cv2.CC_STAT_AREA]),
            inside=_first_pixel(part, k, stats[k]),
        )
        for k in order
    )


def _first_pixel(part: AnyArray, k: int, stats: NDArray[np.int32]) -> tuple[int, int]:
    """Return (x, y) of the first pixel, row by row, of part k, whose box OpenCV's statistics hold."""
    top, left = int(stats[cv2.CC_STAT_TOP]), int(stats[cv2.CC_STAT_LEFT])
    return left + int(np.argmax(part[top, left:] == k)), top
