"""Motion masks: which pixels move by themselves, given the camera's own motion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.pipeline import Estimate
from blur2view.segmentation.network import MotionNetwork
from blur2view.segmentation.object_motion import object_motion
from blur2view.segmentation.regions import MotionCells, decide, decide_by_network, to_pixels, without_small
from blur2view.segmentation.score import MotionScore, motion_score
from blur2view.smears.field import upsample_grid
from blur2view.smears.matches import STRIDE
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
    F, H : ndarray of shape (3, 3) or None
        With ``SegmentOptions.objects``: two-view geometry of its own smears, as in ``TwoViewGeometry``.
    reason : str
        How F or H came about, or why there is neither; empty where it was not asked for.
    """

    area_px: int
    box: tuple[int, int, int, int]
    centroid: tuple[float, float]
    score: float
    inside: tuple[int, int]
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
        two before a still camera, where the squared length of a smear is measured).
    evidence : ndarray of shape (H, W), float32
        What the motion segmentation network says, a probability, before any regularisation; the score where
        the network was not asked.
    regions : tuple of MovingRegion
        The connected moving parts, largest first.
    reason : str
        What the score was measured against.
    model_id : str
        Name of the motion segmentation network's weights; empty if scores decided alone.
    """

    labels: NDArray[np.uint8]
    probability: NDArray[np.float32]
    score: NDArray[np.float32]
    evidence: NDArray[np.float32]
    regions: tuple[MovingRegion, ...]
    reason: str
    model_id: str = ""


@dataclass(frozen=True, kw_only=True)
class SegmentOptions:
    """What is asked for.

    With ``objects`` a motion of its own for every moving part, by ``estimator``. Unless ``learned`` the
    scores of smears decide alone, without the motion segmentation network.
    """

    learned: bool = True
    objects: bool = False
    estimator: EstimatorOptions = field(default_factory=EstimatorOptions)


def segment(
    found: Estimate,
    image: NDArray[np.float32] | None = None,
    options: SegmentOptions | None = None,
    rng: np.random.Generator | None = None,
    network: MotionNetwork | None = None,
) -> MotionMask:
    """Return which pixels move by themselves and which the camera's motion explains.

    Before a camera that moves, a network adds what it sees in the photograph and its smears, and may deny
    what their scores say; before one that stands still, or without the photograph, the scores decide alone.

    Parameters
    ----------
    found : Estimate
        Of one photograph.
    image : ndarray of shape (H, W, 3), float32, optional
        The photograph; with it the mask follows its edges.
    options : SegmentOptions, optional
    rng : numpy.random.Generator, optional
        Of the objects' estimator; ``default_rng(0)`` by default.
    network : MotionNetwork, optional
        The shipped one by default; load it once for many photographs.

    Returns
    -------
    MotionMask
        All unobservable where nothing is known of the camera's motion.

    Raises
    ------
    ValueError, ModelError
        If the image is not of the field's size; if the network cannot be used.
    """
    options, shape = options or SegmentOptions(), found.field.shape
    if image is not None and image.shape != (*shape, 3):
        raise ValueError(f"expected an image of shape {(*shape, 3)}, got {image.shape}")
    if image is not None and options.learned:
        network = network or MotionNetwork()
        found = network.with_local_smears(found, image)
    scored = motion_score(found)
    judged = _judge(found, scored, image, network, options)
    moving, seen = (
        to_pixels(mask.astype(np.float64), image, shape) >= 0.5
        for mask in (judged.cells.moving, judged.cells.observable)
    )
    moving = without_small(moving)
    labels = np.full(shape, MotionLabel.UNOBSERVABLE, np.uint8)
    labels[seen] = MotionLabel.STATIC
    labels[moving] = MotionLabel.MOVING
    regions = moving_regions(moving, score := to_pixels_plainly(scored.score, shape))
    if options.objects:
        regions = with_motions(found, moving, regions, options.estimator, rng)
    return MotionMask(
        labels=labels,
        probability=agreeing(to_pixels(judged.cells.probability, image, shape), moving),
        score=score,
        evidence=judged.evidence,
        regions=regions,
        reason=scored.reason
        + (f"; decided by scores and the network {judged.model_id}" if judged.model_id else ""),
        model_id=judged.model_id,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Judgement:
    """Decisions on a working grid, the evidence (H, W) they rest on, and which network gave it, if any."""

    cells: MotionCells
    evidence: NDArray[np.float32]
    model_id: str = ""


def _judge(
    found: Estimate,
    scored: MotionScore,
    image: NDArray[np.float32] | None,
    network: MotionNetwork | None,
    options: SegmentOptions,
) -> _Judgement:
    """Decide what moves: by the motion segmentation network, or by scores alone."""
    shape = found.field.shape
    if image is None or network is None or not options.learned or scored.still or not scored.reach.any():
        evidence = to_pixels_plainly(scored.score, shape)
        return _Judgement(cells=decide(scored, image, shape), evidence=evidence)
    evidence = network.probability(found, image)
    cells = decide_by_network(scored, image, evidence)
    return _Judgement(cells=cells, evidence=evidence, model_id=network.info.model_id)


def agreeing(probability: NDArray[np.float32], moving: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Bring probabilities (H, W) to the side of 0.5 that a mask (H, W) says, also in steps of 1 / 255."""
    agreed = np.where(moving, np.maximum(probability, MOVES), np.minimum(probability, STAYS))
    return agreed.astype(np.float32)


def with_motions(
    found: Estimate,
    moving: NDArray[np.bool_],
    regions: tuple[MovingRegion, ...],
    options: EstimatorOptions,
    rng: np.random.Generator | None,
) -> tuple[MovingRegion, ...]:
    """Fit a motion to every connected part of a mask (H, W)."""
    rng = np.random.default_rng(0) if rng is None else rng
    fitted = []
    for region in regions:
        own = object_motion(found, region.of(moving), options, rng)
        fitted.append(replace(region, F=own.F, H=own.H, reason=f"{own.config.name}: {own.reason}"))
    return tuple(fitted)


def to_pixels_plainly(grid: Array, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Resample the network's grid (h, w) to pixels (H, W)."""
    large = upsample_grid(grid[..., None].astype(np.float32), STRIDE)[: shape[0], : shape[1], 0]
    missing = [(0, side - have) for side, have in zip(shape, large.shape, strict=True)]
    return np.pad(large, missing, mode="edge")


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


def _first_pixel(part: NDArray[np.int32], k: int, stats: NDArray[np.int32]) -> tuple[int, int]:
    """Return (x, y) of the first pixel, row by row, of part k, whose box OpenCV's statistics hold."""
    top, left = int(stats[cv2.CC_STAT_TOP]), int(stats[cv2.CC_STAT_LEFT])
    return left + int(np.argmax(part[top, left:] == k)), top
