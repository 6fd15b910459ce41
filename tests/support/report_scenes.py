"""Made-up estimates for the tests of the report: every value on the page is known from here."""

import numpy as np
from numpy.typing import NDArray

from blur2view import (
    Configuration,
    MotionLabel,
    MotionMask,
    SelectOptions,
    TwoViewGeometry,
    blur_of,
    select_matches,
)
from blur2view.geometry.epipolar import fundamental_from_pose, serrmin
from blur2view.geometry.rotation import rotation_matrix
from blur2view.pipeline import Estimate
from tests.support.grids import grid_of

WIDTH, HEIGHT = 640, 360
MOVING_BOX = (100, 60, 200, 160)  # left, top, right, bottom of what moves


def turning_F() -> NDArray[np.float64]:
    """F of a camera that moves and turns, so that the two lines of a smear are well apart."""
    K = np.array([[500.0, 0, WIDTH / 2], [0, 500.0, HEIGHT / 2], [0, 0, 1]])
    return fundamental_from_pose(K, rotation_matrix(np.array([0.02, -0.03, 0.1])), np.array([0.3, 0.1, 0.2]))


def made_up(F: NDArray[np.float64] | None = None) -> tuple[Estimate, NDArray[np.float32]]:
    """Return a made-up estimate of a black photograph, and it.

    Smears, in cells of 32 pixels, differ from their neighbours in every value. The half that fits F better
    are inliers, none without F.
    """
    y, x = 32 * np.mgrid[: -(-HEIGHT // 32), : WIDTH // 32] + 15.5
    displacement = np.stack([18 + 6 * np.sin(x / 50), 9 * np.cos(y / 40 + x / 90)], axis=-1)
    sigma_px, sigma_rad = 0.5 + 4 * x / WIDTH, 0.05 + 0.3 * y / HEIGHT
    grid = grid_of(displacement, sigma_px, sigma_rad, stride=32, shape=(HEIGHT, WIDTH))
    used = select_matches(grid, SelectOptions(max_matches=300))
    errors = np.zeros(len(used)) if F is None else serrmin(F, used.ends)
    geometry = TwoViewGeometry(
        F=F,
        config=Configuration.UNCALIBRATED,
        reason="the figures <that> decided & more",
        inlier_mask=errors < np.median(errors),
        second_end_is_open=np.zeros(len(used), bool),
    )
    estimate = Estimate(grid=grid, blur=blur_of(grid), matches=used, geometry=geometry, model_id="made-up")
    return estimate, np.zeros((HEIGHT, WIDTH, 3), np.float32)


def boxed_mask() -> MotionMask:
    """Give a mask with a box that moves; the right quarter is unknown."""
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    left, top, right, bottom = MOVING_BOX
    labels[top:bottom, left:right] = MotionLabel.MOVING
    labels[:, 3 * WIDTH // 4 :] = MotionLabel.UNOBSERVABLE
    probability = np.where(labels == MotionLabel.MOVING, 0.9, 0.1).astype(np.float32)
    return MotionMask(labels=labels, probability=probability, regions=(), reason="F")
