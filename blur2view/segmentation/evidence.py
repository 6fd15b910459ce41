"""What speaks for and against moving by itself: smears against the camera's motion, and blur in the picture.

Smears are read in windows of three cells' width. Gradients along the direction in which the camera's motion
blurs are what a finer look shows: they are weak where only the camera moved, and not where an object stood
still with respect to it, or moved elsewhere. So the evidence lies on a grid of half a cell.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Array
from blur2view.geometry.sampson import serrmin
from blur2view.segmentation.camera_motion import Cells
from blur2view.smears.field import to_double_angle, upsample_grid

SEEN_PX = 2.0  # shortest smear whose direction is read
FINER = 2  # places of evidence on a cell's side
OCTAVES = 3  # the photograph, and halves of it, in which gradients are measured
STRIP = 8  # cells' rows at a time: bounds the memory
LEAST_GRADIENT = 1e-5  # mean square, of levels in [0, 1] a pixel
LINE_FLOOR_PX = 0.4  # error of smears across the epipolar lines that no cell states
SMOOTH = 1.5e-6  # mean square gradient below which a window shows nothing: a third of a level of 255 a pixel


def evidence(cells: Cells, camera: Array, F: Array | None, gradients: Array) -> Array:
    """Return the evidence (FINER h, FINER w, K), most of it logarithms.

    Parameters
    ----------
    cells : Cells
        (h, w).
    camera : ndarray of shape (h, w, 2)
        Displacements of the camera's motion, pixels.
    F : ndarray of shape (3, 3) or None
    gradients : ndarray of shape (FINER h, FINER w, 3 OCTAVES)
        See `gradients_of`.
    """
    coarse = upsample_grid(_of_cells(cells, camera, F).astype(np.float32), FINER)
    double = np.concatenate([to_double_angle(camera), to_double_angle(cells.displacement)], axis=-1)
    fine = upsample_grid(double.astype(np.float32), FINER)
    blur = [_along_and_across(gradients, fine[..., k : k + 2]) for k in (0, 2)]
    return np.concatenate([coarse, *blur], axis=-1)


def _of_cells(cells: Cells, camera: Array, F: Array | None) -> Array:
    """Return what the smears of the cells show, (h, w, 13)."""
    seen, length, error = cells.displacement, cells.length_px, cells.error_px
    expected = np.linalg.norm(camera, axis=-1)
    apart = np.minimum(*(np.linalg.norm(seen - sign * camera, axis=-1) for sign in (1, -1)))
    scale = max(float(np.median(apart / error)), 0.5)
    cosine = np.abs((seen * camera).sum(-1)) / np.maximum(length * expected, 1e-6)
    angle = np.arccos(np.minimum(cosine, 1.0))
    readable = np.minimum(np.minimum(length, expected) / SEEN_PX, 1.0) ** 2
    across = np.zeros_like(length) if F is None else off_lines_px(cells, F)
    evidence = [
        np.log1p(apart / (scale * error)),
        np.log1p(apart),
        readable * np.log1p(angle / np.hypot(cells.sigma_rad, 0.03)),
        np.log((length + 1) / (expected + 1)),
        np.log1p(across / off_lines_error_px(cells)),
        np.log1p(across),
        np.log1p(length),
        np.log1p(expected),
        np.log(cells.sigma_px / (length + 2) + 0.02),
        np.log(cells.sigma_rad + 0.01),
        np.full(length.shape, float(F is not None)),
    ]
    return np.stack([*evidence, *np.moveaxis(_turned_difference(seen, camera), -1, 0)], axis=-1)


def off_lines_px(cells: Cells, F: Array) -> Array:
    """Return how far the ends are off the epipolar lines, (h, w); 0 where a camera has no ray."""
    squared = np.nan_to_num(serrmin(F, cells.ends.reshape(-1, 2, 2)))
    return np.asarray(np.sqrt(squared).reshape(cells.ends.shape[:2]))


def off_lines_error_px(cells: Cells) -> Array:
    """Return the standard deviations (h, w) of the same."""
    return np.hypot(cells.length_px * cells.sigma_rad, LINE_FLOOR_PX)


def _turned_difference(seen: Array, camera: Array) -> Array:
    """Return seen less expected smears (h, w, 2) in double angle, turned to the expected direction, relative.

    Of the second component only the size: mirrored pictures are alike.
    """
    one, other = (np.asarray(to_double_angle(d)) @ np.array([1, 1j]) for d in (seen, camera))
    apart = (one - other) * np.exp(-1j * np.angle(other)) / (np.abs(one) + np.abs(other) + 2)
    return np.stack([apart.real, np.abs(apart.imag)], axis=-1)


def _along_and_across(gradients: Array, direction: AnyArray) -> Array:
    """Return logs of mean squared gradients along and across directions in double angle, (..., 2 OCTAVES)."""
    unit = direction / np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-6)
    logs = []
    for octave in range(OCTAVES):
        total, c, s = np.moveaxis(gradients[..., 3 * octave : 3 * octave + 3], -1, 0)
        turned = c * unit[..., 0] + s * unit[..., 1]
        logs += [np.log(0.5 * (total + sign * turned) + LEAST_GRADIENT) for sign in (1, -1)]
    return np.stack(logs, axis=-1)


def smooth(gradients: Array) -> NDArray[np.bool_]:
    """Return the half cells (FINER h, FINER w) about which, over three cells, the picture shows nothing."""
    size = 3 * FINER
    return np.asarray(cv2.blur(np.ascontiguousarray(gradients[..., 0], np.float32), (size, size)) < SMOOTH)


def gradients_of(image: NDArray[np.float32], grid: tuple[int, int], stride: int) -> Array:
    """Return the mean squared gradients of an image (H, W, 3), (FINER h, FINER w, 3 OCTAVES).

    About half cells, of each octave gx^2 + gy^2, gx^2 - gy^2 and 2 gx gy: rotated like double angles.
    ``grid`` is (h, w).
    """
    strips = []
    for first in range(0, grid[0], STRIP):
        above, below = max(first - 1, 0), min(first + STRIP + 1, grid[0])
        part = image[above * stride : below * stride]
        grey = cv2.cvtColor(np.ascontiguousarray(part), cv2.COLOR_RGB2GRAY)
        missing = (below - above) * stride - grey.shape[0], grid[1] * stride - grey.shape[1]
        grey = np.pad(grey, ((0, missing[0]), (0, missing[1])), mode="symmetric")
        rows = slice(FINER * (first - above), FINER * (min(first + STRIP, grid[0]) - above))
        strips.append(_gradients(grey, (FINER * (below - above), FINER * grid[1]))[rows])
    return np.concatenate(strips)


def _gradients(grey: AnyArray, shape: tuple[int, int]) -> Array:
    """Return the same of one grey strip (H, W), at places (rows, columns) that divide it."""
    layers = []
    for _ in range(OCTAVES):
        dx, dy = (0.125 * cv2.Sobel(grey, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
        squares = np.dstack([dx * dx + dy * dy, dx * dx - dy * dy, 2 * dx * dy])
        layers.append(cv2.resize(squares, shape[::-1], interpolation=cv2.INTER_AREA))
        grey = cv2.resize(grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA)
    return np.concatenate(layers, axis=-1)
