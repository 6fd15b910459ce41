"""Motion masks: which pixels move by themselves, given the camera's own motion."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray
from blur2view.movers.parts import THRESHOLD
from blur2view.movers.probability import moving_probability
from blur2view.networks.smear_network import photograph_of
from blur2view.networks.threads import one_thread
from blur2view.pipeline import Estimate
from blur2view.segmentation.pixels import MovingRegion, moving_parts, moving_regions, to_pixels

STILL_PX = 1.0
"""Median displacement of the camera's motion below which it stands still."""
SHARED = 0.4
"""Share of what is read in the picture from which on it is open which motion is the camera's."""


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


@one_thread
def segment(
    estimate: Estimate,
    image: AnyArray,
    rng: np.random.Generator | None = None,
    *,
    threshold: float = THRESHOLD,
) -> MotionMask:
    """Return which pixels move by themselves and which the camera's motion explains.

    The camera's motion is one smooth field through the smears (`movers.camera_motion`), none where the camera
    did not move (`Estimate.blur`), and, where there is one and the photograph has at most 2.5 megapixels, F.
    A network (`movers.network`) weighs what departs from both, and where the picture is blurred otherwise
    than the camera's motion blurs it; the camera's motion is then fitted again without what moves.
    Unobservable is what does not seem to move and is smooth, or whose smear is not read.

    Parameters
    ----------
    estimate : Estimate
        Of one photograph.
    image : ndarray of shape (H, W, 3) or (H, W)
        The photograph, as it was estimated.
    rng : numpy.random.Generator, optional
        Draws starts of the fit; ``default_rng(0)`` by default.
    threshold : float
        Probability from which on a connected part moves, above 0 and below 1. A lower one misses less of what
        moves, and marks more of what stands still.

    Raises
    ------
    ValueError
        If the image has another shape than the estimate, or the threshold is no such probability.
    """
    image, grid = photograph_of(image), estimate.grid
    if image.shape[:2] != grid.shape:
        raise ValueError(f"expected the photograph of the estimate, {grid.shape}, got {image.shape}")
    if not 0 < threshold < 1:
        raise ValueError(f"the threshold must be a probability above 0 and below 1, got {threshold}")
    rng = np.random.default_rng(0) if rng is None else rng
    # the F of a rolling shutter is not of the ends as recorded
    F = estimate.geometry.F if estimate.shutter is None else None
    found = estimate.moving  # of a camera at rest
    if found is None or estimate.blur.kind.of_camera:
        starts = rng if estimate.blur.kind.of_camera else None
        found = moving_probability(image, grid, F, estimate.camera, starts, estimate.execution)
    probability = to_pixels(found.moving, image, found.place_px)
    parts = moving_parts(found.part, image, threshold, found.place_px)
    labels = np.full(probability.shape, MotionLabel.UNOBSERVABLE, np.uint8)
    seen = np.kron((found.read >= 0.5) & ~found.smooth, np.ones((found.place_px, found.place_px), bool))
    labels[seen[: image.shape[0], : image.shape[1]]] = MotionLabel.STATIC
    labels[parts] = MotionLabel.MOVING
    return MotionMask(
        labels=labels,
        probability=probability,
        regions=moving_regions(parts, probability),
        reason=_reason(labels, found.camera_px, with_lines=found.with_lines),
    )


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
