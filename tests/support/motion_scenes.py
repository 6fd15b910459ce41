"""Smears of a camera that moves, of a box that moves by itself before it, and what is made of them."""

from dataclasses import replace

import numpy as np
from blur2view.smears.selection import select_matches
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry
from blur2view.pipeline import Estimate, Timings
from blur2view.segmentation.mask import MotionMask, SegmentOptions, segment
from blur2view.smears.field import SmearField

HEIGHT, WIDTH = 240, 320
SIDEWAYS = cross_matrix(np.array([1.0, 0.0, 0.0])) / 2**0.5  # epipolar lines are horizontal
BOX = slice(80, 160), slice(180, 270)
STATIC_PX, MOVER = 12.0, (3.0, 18.0)
SURE_RAD = 0.05
SHIFT = np.array([[1, 0, STATIC_PX], [0, 1, 0], [0, 0, 1.0]])


def sideways(shape: tuple[int, int] = (HEIGHT, WIDTH)) -> NDArray[np.float32]:
    """Smears (H, W, 2) of a camera that moves along x."""
    displacement = np.zeros((*shape, 2), np.float32)
    displacement[..., 0] = STATIC_PX
    return displacement


def with_mover() -> NDArray[np.float32]:
    displacement = sideways()
    displacement[BOX] = MOVER
    return displacement


def photo() -> NDArray[np.float32]:
    """Give a grey wall with some grain, and an orange box on it."""
    image = np.random.default_rng(0).normal(0.5, 0.02, (HEIGHT, WIDTH, 3)).astype(np.float32)
    image[BOX] += np.array([0.3, 0.0, -0.3], np.float32)
    return np.clip(image, 0, 1)


def estimate_of(
    displacement: NDArray[np.float32],
    F: Array | None = None,
    H: Array | None = None,
    sigma_px: float | NDArray[np.float32] = 1.0,
    sigma_rad: float | NDArray[np.float32] = SURE_RAD,
) -> Estimate:
    """Make what the pipeline would have, were the camera's motion F or H."""
    shape = displacement.shape[:2]
    field = SmearField(
        displacement=displacement,
        sigma_px=np.broadcast_to(np.float32(sigma_px), shape),
        sigma_rad=np.broadcast_to(np.float32(sigma_rad), shape),
    )
    matches = select_matches(field)
    none = np.zeros(len(matches), bool)
    geometry = TwoViewGeometry(
        F=F, H=H, config=Configuration.UNDEFINED, reason="told by the test", inlier_mask=none, swapped=none
    )
    return Estimate(
        field=field,
        matches=matches,
        geometry=geometry,
        model_id="test",
        timings=Timings(predict_s=0, select_s=0, solve_s=0),
    )


def by_scores(found: Estimate, options: SegmentOptions | None = None) -> MotionMask:
    """Segment by the estimate's own motion alone, which the test made up."""
    return segment(found, replace(options or SegmentOptions(), splits=0))
