"""Smears of a camera that moves, of a box that moves by itself before it, and photographs of them."""

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view import Configuration, Estimate, SmearMatches, Timings, TwoViewGeometry, blur_of
from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix
from tests.support.grids import grid_of

HEIGHT, WIDTH, STRIDE = 480, 640, 32
SIDEWAYS = cross_matrix(np.array([1.0, 0.0, 0.0])) / 2**0.5  # epipolar lines are horizontal
BOX = slice(160, 320), slice(352, 544)
STATIC_PX, MOVER = 12.0, (3.0, 24.0)


def sideways(shape: tuple[int, int] = (HEIGHT, WIDTH)) -> NDArray[np.float32]:
    """Smears (H, W, 2) of a camera that moves along x."""
    displacement = np.zeros((*shape, 2), np.float32)
    displacement[..., 0] = STATIC_PX
    return displacement


def with_mover() -> NDArray[np.float32]:
    displacement = sideways()
    displacement[BOX] = MOVER
    return displacement


def photo(displacement: NDArray[np.float32], texture: float = 0.3, seed: int = 0) -> NDArray[np.float32]:
    """Give noise of a scale of 1.5 px that is blurred along smears (H, W, 2), few different ones."""
    shape = displacement.shape[:2]
    noise = np.random.default_rng(seed).normal(0, 1, (*shape, 3)).astype(np.float32)
    sharp = np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.5)) * 5
    image = np.zeros_like(sharp)
    for x, y in np.unique(displacement.reshape(-1, 2), axis=0):
        size = 2 * int(max(abs(x), abs(y))) + 3
        kernel, middle = np.zeros((size, size), np.float32), (size - 1) / 2
        ends = [
            np.round(16 * (middle + sign * np.array([x, y]) / 2)).astype(int).tolist() for sign in (-1, 1)
        ]
        cv2.line(kernel, ends[0], ends[1], 1.0, 1, cv2.LINE_AA, 4)
        blurred = cv2.filter2D(sharp, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)
        here = (displacement == (x, y)).all(axis=-1)
        image[here] = blurred[here]
    return np.asarray(np.clip(0.5 + texture * image, 0, 1), np.float32)


def estimate_of(
    displacement: NDArray[np.float32], F: Array | None = None, sigma_px: float = 0.8, sigma_rad: float = 0.04
) -> Estimate:
    """Make what the pipeline would have of smears (H, W, 2), were the camera's motion F."""
    height, width = displacement.shape[:2]
    centres = [np.minimum(np.arange(STRIDE // 2, n + STRIDE // 2, STRIDE), n - 1) for n in (height, width)]
    here = displacement[np.ix_(*centres)]
    grid = grid_of(here, sigma_px, sigma_rad, stride=STRIDE, shape=(height, width))
    none = np.zeros(0, bool)
    geometry = TwoViewGeometry(
        F=F,
        H=None,
        config=Configuration.UNDEFINED,
        reason="told by the test",
        inlier_mask=none,
        second_end_is_open=none,
    )
    return Estimate(
        grid=grid,
        blur=blur_of(grid),
        matches=SmearMatches(ends=np.zeros((0, 2, 2)), sigma_px=np.zeros(0)),
        geometry=geometry,
        model_id="test",
        timings=Timings(predict_s=0, select_s=0, solve_s=0),
    )
