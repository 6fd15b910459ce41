"""Motion masks: which pixels move by themselves, given the camera's own motion."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Array
from blur2view.geometry.two_view_geometry import Parallax
from blur2view.networks.smear_network import rgb_of
from blur2view.pipeline import Estimate
from blur2view.segmentation.camera_motion import Cells, camera_field
from blur2view.segmentation.classifier import shipped
from blur2view.segmentation.evidence import (
    FINER,
    evidence,
    gradients_of,
    off_lines_error_px,
    off_lines_px,
    smooth,
)
from blur2view.segmentation.pixels import (
    MOST_STILL,
    MovingRegion,
    moving_parts,
    moving_regions,
    parts_above,
    to_pixels,
)
from blur2view.smears.blur import BlurKind

ROUNDS = 2  # fits of the camera's motion, the second without what moves
STILL_PX = 1.0  # median displacement of the camera's motion below which it stands still
SHARED = 0.4  # of what is read in the picture: from there on it is open which motion is the camera's
# Mean deviations off the lines, where parallax is proven, below which a part is at another depth: of ten such
# parts of 175 development scenes the eight that stand still have 0.1 to 1.3, the two that move 1.5 and 1.7.
OFF_LINES = 1.35
DEPTH_MOVES = 0.1  # probability of moving that is left to these, and where nothing is found to move
# The probability of which a part has pixels, and of what share of it: before a camera that moves more, for
# depth looks like motion (a parked car of a street: 0.6 in 0.15 of it, which chose the share).
BEFORE_MOVING, BEFORE_STILL = (0.6, 0.2), (0.55, 0.0)


class MotionLabel(IntEnum):
    """What a pixel of a motion mask shows."""

    STATIC = 0
    MOVING = 1
    UNOBSERVABLE = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionMask:
    """Which pixels move by themselves.

    Parameters
    ----------
    labels : ndarray of shape (H, W), uint8
        `MotionLabel`: 0 static, 1 moving, 2 unobservable.
    probability : ndarray of shape (H, W), float32
        That a pixel moves, in [0, 1]; calibrated on rendered photographs with movers, where a tenth of the
        pixels moves.
    regions : tuple of MovingRegion
        The connected moving parts, largest first.
    reason : str
        What motion was measured against.
    """

    labels: NDArray[np.uint8]
    probability: NDArray[np.float32]
    regions: tuple[MovingRegion, ...]
    reason: str


def segment(estimate: Estimate, image: AnyArray, rng: np.random.Generator | None = None) -> MotionMask:
    """Return which pixels move by themselves and which the camera's motion explains.

    The camera's motion is one smooth field through the smears and, where there is one, F. What departs from
    both, and where the picture is blurred otherwise than the camera's motion blurs it, is weighed by a small
    network (`classifier`); the camera's motion is then fitted again without what moves. Where parallax is
    proven, parts on the epipolar lines are at another depth and stand still. Where the camera did not move
    (`Estimate.blur`), what is smeared moves. Unobservable is what is smooth,
    what is read badly, and what may as well move as stand still.

    Parameters
    ----------
    estimate : Estimate
        Of one photograph.
    image : ndarray of shape (H, W, 3) or (H, W)
        The photograph, as it was estimated.
    rng : numpy.random.Generator, optional
        Draws starts of the fit; ``default_rng(0)`` by default.

    Raises
    ------
    ValueError
        If the image has another shape than the estimate.
    """
    image, grid, geometry = rgb_of(image), estimate.grid, estimate.geometry
    if image.shape[:2] != grid.shape:
        raise ValueError(f"expected the photograph of the estimate, {grid.shape}, got {image.shape}")
    rng = np.random.default_rng(0) if rng is None else rng
    F = geometry.F if estimate.shutter is None else None  # a shutter's F is not of the ends as recorded
    cells = Cells.of(grid, estimate.camera)
    gradients = gradients_of(image, grid.cells.shape[:2], grid.stride)
    kind = estimate.blur.kind
    median_px, moving, read = _log_odds(cells, F, gradients, rng if kind.of_camera else None)
    hidden = smooth(gradients)
    moves, reads = (_share(np.where(hidden, -np.inf, odds)) for odds in (moving, read))
    size_px = grid.stride // FINER
    hidden = hidden.repeat(size_px, axis=0)[: image.shape[0]].repeat(size_px, axis=1)[:, : image.shape[1]]
    probability = to_pixels(moves, size_px, image)
    probability[hidden] = 0  # outlines follow edges, also into what is smooth
    if not (kind.of_camera or kind is BlurKind.CAMERA_AT_REST):
        probability *= np.float32(DEPTH_MOVES)
    parts = moving_parts(probability, *(BEFORE_MOVING if median_px >= STILL_PX else BEFORE_STILL))
    if F is not None and geometry.parallax is Parallax.PROVEN and median_px >= STILL_PX:
        off_lines = off_lines_px(cells, F) / off_lines_error_px(cells)
        depth = parts & ~parts_above(parts, off_lines, OFF_LINES, grid.stride)
        probability[depth] = np.minimum(probability[depth], DEPTH_MOVES)
        parts &= ~depth
    labels = np.full(probability.shape, MotionLabel.UNOBSERVABLE, np.uint8)
    observable = (to_pixels(reads, size_px, image) >= 0.5) & ~hidden
    labels[observable & (probability < MOST_STILL)] = MotionLabel.STATIC
    labels[parts] = MotionLabel.MOVING
    return MotionMask(
        labels=labels,
        probability=probability,
        regions=moving_regions(parts, probability),
        reason=_reason(labels, median_px, with_lines=F is not None),
    )


def _log_odds(
    cells: Cells, F: Array | None, gradients: Array, rng: np.random.Generator | None
) -> tuple[float, Array, Array]:
    """Return the camera's median motion, pixels, and log-odds (FINER h, FINER w) of moving and of reading.

    Without a generator the camera is at rest.
    """
    weight: Array = np.ones(cells.sigma_px.shape)
    motion = np.zeros_like(cells.displacement)
    for _ in range(1 if rng is None else ROUNDS):
        motion = motion if rng is None else camera_field(cells, weight, rng)
        moving, read = shipped().log_odds(evidence(cells, motion, F, gradients))
        moves = cv2.resize(_share(moving), weight.shape[::-1], interpolation=cv2.INTER_AREA)
        weight = 1 - np.asarray(moves, float)
    return float(np.median(np.linalg.norm(motion, axis=-1))), moving, read


def _share(log_odds: Array) -> NDArray[np.float32]:
    return np.asarray(1 / (1 + np.exp(-np.clip(log_odds, -30, 30))), np.float32)


def _reason(labels: NDArray[np.uint8], median_px: float, *, with_lines: bool) -> str:
    if (labels == MotionLabel.UNOBSERVABLE).all():
        return "nothing to measure against: no smear of the camera's motion is read"
    still = median_px < STILL_PX
    field = "a camera that stands still" if still else f"a smooth motion of {median_px:.0f} px (median)"
    lines = " and the epipolar lines of the camera's F" if with_lines else ""
    moves, stays = ((labels == label).mean() for label in (MotionLabel.MOVING, MotionLabel.STATIC))
    reason = f"measured against {field}{lines}"
    if moves > SHARED * (moves + stays):
        reason += f"; {moves:.0%} follows another motion, which may as well be the camera's"
    return reason
