"""Motion masks: which pixels move by themselves, given the camera's own motion."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.pipeline import Estimate
from blur2view.segmentation.camera_motion import Cells, camera_field
from blur2view.segmentation.classifier import shipped
from blur2view.segmentation.evidence import FINER, evidence, gradients_of, smooth
from blur2view.segmentation.pixels import (
    MOST_STILL,
    MovingRegion,
    moving_parts,
    moving_regions,
    to_pixels,
)
from blur2view.smears.field import smear_ends

ROUNDS = 2  # fits of the camera's motion, the second without what moves
STILL_PX = 1.0  # median displacement of the camera's motion below which it stands still
SHARED = 0.4  # of what is read in the picture: from there on it is open which motion is the camera's


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


def segment(
    found: Estimate, image: NDArray[np.float32], rng: np.random.Generator | None = None
) -> MotionMask:
    """Return which pixels move by themselves and which the camera's motion explains.

    The camera's motion is one smooth field through the smears and, where there is one, F. What departs from
    both, and where the picture is blurred otherwise than the camera's motion blurs it, is weighed by a small
    network (`classifier`); the camera's motion is then fitted again without what moves. Unobservable is what
    is smooth, what is read badly, and what may as well move as stand still.

    Parameters
    ----------
    found : Estimate
        Of one photograph.
    image : ndarray of shape (H, W, 3), float32
        The photograph, sRGB-coded RGB in [0, 1].
    rng : numpy.random.Generator, optional
        Draws starts of the fit; ``default_rng(0)`` by default.

    Raises
    ------
    ValueError
        If the image has another shape than the estimate, or the estimate has no grid of smears.
    """
    if found.grid is None or image.shape[:2] != found.grid.shape:
        shape = None if found.grid is None else found.grid.shape
        raise ValueError(f"expected the photograph of the estimate, {shape}, got {image.shape}")
    cells, grid = Cells.of(found.grid), found.grid
    rng = np.random.default_rng(0) if rng is None else rng
    gradients = gradients_of(image, grid.cells.shape[:2], grid.stride)
    weight: Array = np.ones(cells.sigma_px.shape)
    for _ in range(ROUNDS):
        looked = Looked.of(cells, found.geometry.F, found.camera, gradients, weight, rng)
        moving, read = shipped().log_odds(looked.evidence)
        moves = cv2.resize(_share(moving), weight.shape[::-1], interpolation=cv2.INTER_AREA)
        weight = 1 - np.asarray(moves, float)
    hidden = smooth(gradients)
    moving, read = (np.where(hidden, -np.inf, odds) for odds in (moving, read))
    return _mask(found, image, looked.camera, moving, read)


@dataclass(frozen=True, kw_only=True, eq=False)
class Looked:
    """The camera's motion (h, w, 2) in every cell, pixels, and the evidence of half cells against it."""

    camera: Array
    evidence: Array

    @classmethod
    def of(
        cls,
        cells: Cells,
        F: Array | None,
        camera: Camera | None,
        gradients: Array,
        weight: Array,
        rng: np.random.Generator,
    ) -> Looked:
        """Fit the camera's motion to cells that count by their weights (h, w), and compare."""
        motion = camera_field(cells, weight, rng)
        ends = smear_ends(cells.points.reshape(-1, 2), cells.displacement.reshape(-1, 2))
        if camera is not None and camera.distorted:
            ends = camera.undistorted(ends)  # of which F is
        ends = ends.reshape(*weight.shape, 2, 2)
        return cls(camera=motion, evidence=evidence(cells, motion, ends, F, gradients))


def _share(log_odds: Array) -> NDArray[np.float32]:
    """Return probabilities."""
    return np.asarray(1 / (1 + np.exp(-np.clip(log_odds, -30, 30))), np.float32)


def _mask(
    found: Estimate, image: NDArray[np.float32], camera: Array, moving: Array, read: Array
) -> MotionMask:
    """Return the mask of log-odds that half cells move and are read right."""
    assert found.grid is not None
    size_px = found.grid.stride // FINER
    height, width = image.shape[:2]
    hidden = np.isneginf(read).repeat(size_px, axis=0)[:height].repeat(size_px, axis=1)[:, :width]
    probability = to_pixels(_share(moving), size_px, image)
    probability[hidden] = 0  # outlines follow edges, also into what is smooth
    observable = (to_pixels(_share(read), size_px, image) >= 0.5) & ~hidden
    parts = moving_parts(probability)
    labels = np.full(probability.shape, MotionLabel.UNOBSERVABLE, np.uint8)
    labels[observable & (probability < MOST_STILL)] = MotionLabel.STATIC
    labels[parts] = MotionLabel.MOVING
    return MotionMask(
        labels=labels,
        probability=probability,
        regions=moving_regions(parts, probability),
        reason=_reason(found, camera, labels),
    )


def _reason(found: Estimate, camera: Array, labels: NDArray[np.uint8]) -> str:
    """Say what motion was measured against."""
    if (labels == MotionLabel.UNOBSERVABLE).all():
        return "nothing to measure against: no smear of the camera's motion is read"
    median = float(np.median(np.linalg.norm(camera, axis=-1)))
    field = "the camera stands still" if median < STILL_PX else f"a smooth motion of {median:.0f} px (median)"
    lines = " and the epipolar lines of the camera's F" if found.geometry.F is not None else ""
    moves, stays = ((labels == label).mean() for label in (MotionLabel.MOVING, MotionLabel.STATIC))
    said = f"measured against {field}{lines}"
    if moves > SHARED * (moves + stays):
        said += f"; {moves:.0%} follows another motion, which may as well be the camera's"
    return said
