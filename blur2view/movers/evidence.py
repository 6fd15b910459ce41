"""Inputs of the two networks that find what moves by itself.

``models/unet.onnx`` sees the photograph and what the smear network says of its cells. ``models/movers.onnx``
sees the smears of cells against the camera's motion and, on places of 4 x 4 pixels, gradients along the
direction in which that motion blurs: they are weak where only the camera moved, and not where an object stood
still with respect to it, or moved elsewhere.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.networks.octave_reader import LENGTHS
from blur2view.smears.grid import SmearGrid, to_double_angle, upsample_grid
from blur2view.smears.likelihood import DIRECTIONS, IN_FOCUS_PX, KINDS

Floats = NDArray[np.float32]

PLACE_PX = 4
"""Side of the places that both networks answer for, pixels."""
CELL_VALUES = DIRECTIONS + LENGTHS + len(KINDS) + 1
"""Square roots of the shares of directions and of lengths, kinds of blur, logarithm of the radius."""
LEAST_PX = 0.1
"""Least standard deviation of a cell's smear that is believed."""
FLOOR_PX, FLOOR_SHARE = 0.4, 0.05
"""Errors that no cell states: constant, and in proportion to its length."""
SEEN_PX = 2.0
"""Shortest smear whose direction is read."""
OCTAVES = 3
"""The photograph, and halves of it, in which gradients are measured."""
LEAST_GRADIENT = 1e-5
"""Mean square, of levels in [0, 1] a pixel."""
SMOOTH = 1.5e-6
"""Mean square gradient below which a window shows nothing: a third of a level of 255 a pixel."""
SMOOTH_PX = 96
"""Side of the windows that may show nothing: those the smears are read in."""
SAMPLES, SCORED = 150, 400
"""Triples of cells through which the camera's fields start, and cells on which they are scored."""
SIGNS = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]], float)
STEPS = 12
"""Of reweighted least squares."""
RIDGE, RIDGE_SHARE = 0.3, 0.3
"""Weight, in cells, of each quadratic coefficient of the field over this share of the median length."""


class Cells(NamedTuple):
    """The smears (h, w, 2) of a grid, of either sign, and their deviations (h, w); pixels, radians."""

    displacement: Array
    sigma_px: Array
    sigma_rad: Array

    @classmethod
    def of(cls, grid: SmearGrid) -> Cells:
        """Return the cells of a grid."""
        smears = grid.smears()
        sigma_px = np.maximum(smears.sigma_px.astype(float), LEAST_PX)
        sigma_rad = np.minimum(smears.sigma_rad.astype(float), np.pi / 2)
        return cls(smears.displacement.astype(float), sigma_px, sigma_rad)

    @property
    def length_px(self) -> Array:
        """Lengths (h, w)."""
        return np.asarray(np.linalg.norm(self.displacement, axis=-1))

    @property
    def error_px(self) -> Array:
        """Standard deviations (h, w) with the errors that no cell states."""
        return np.hypot(self.sigma_px, FLOOR_PX + FLOOR_SHARE * self.length_px)


def camera_field(grid: SmearGrid, weight: Array, rng: np.random.Generator) -> Array:
    """Return the displacement (h, w, 2) that the camera's motion gives every cell of a grid, pixels.

    A quadratic polynomial of the place, as instantaneous rotations and planes give it. The sign of a smear is
    the one nearer to the field. Affine fields through three cells each, in every choice of signs, are
    starts, which ``rng`` draws; that of least Geman-McClure cost is refined by reweighted least squares.
    ``weight`` (h, w), 0 to 1, is little where something else is known to move.
    """
    cells, size = Cells.of(grid), np.array(grid.shape[::-1])
    seen, counted = cells.displacement.reshape(-1, 2), weight.ravel()
    x, y = (grid.points().reshape(-1, 2) - (size - 1) / 2).T / (max(size) / 2)
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    sigma, model = cells.error_px.ravel(), np.zeros((6, 2))
    model[:3] = _start(basis[:, :3], seen, sigma, counted, rng)
    length = RIDGE_SHARE * max(float(np.median(np.linalg.norm(seen, axis=1))), 1.0)
    ridge = np.diag(np.array([0, 0, 0, 1, 1, 1]) * RIDGE / length**2 + 1e-9)
    for _ in range(STEPS):
        predicted = basis @ model
        signed = np.where((predicted * seen).sum(axis=1, keepdims=True) < 0, -seen, seen)
        squared = ((signed - predicted) ** 2).sum(axis=1) / (4 * sigma**2)
        weighed = basis * (counted / (1 + squared) ** 2 / sigma**2)[:, None]
        model = np.linalg.solve(weighed.T @ basis + ridge, weighed.T @ signed)
    return np.asarray((basis @ model).reshape(cells.displacement.shape))


def _start(basis: Array, seen: Array, sigma: Array, weight: Array, rng: np.random.Generator) -> Array:
    """Return the affine field (3, 2) of least cost through three cells each, or constant as one."""
    share = weight / sigma
    share = share / share.sum() if share.sum() > 0 else np.full(len(seen), 1 / len(seen))
    triples = rng.choice(len(seen), (SAMPLES, 3), p=share)
    inverse = np.linalg.pinv(basis[triples], rcond=1e-3)  # (S, 3, 3)
    signed = seen[triples][:, None] * SIGNS[None, :, :, None]  # (S, 4, 3, 2)
    constant = np.zeros((SAMPLES, 3, 2))
    constant[:, 0] = seen[triples[:, 0]]
    models = np.concatenate([(inverse[:, None] @ signed).reshape(-1, 3, 2), constant])
    scored = rng.permutation(len(seen))[:SCORED]
    x, y = (models[..., k] @ basis[scored].T for k in (0, 1))  # (M, SCORED)
    seen_x, seen_y = seen[scored].T
    squared = x * x + y * y + (seen_x**2 + seen_y**2) - 2 * np.abs(x * seen_x + y * seen_y)
    error = squared / (4 * sigma[scored] ** 2)
    cost = (weight[scored] / sigma[scored] * error / (1 + error)).sum(axis=1)
    return np.asarray(models[np.argmin(cost)])


def cell_values(grid: SmearGrid) -> Floats:
    """Return what the smear network says of the cells of a grid, (h, w, 70), as the U-Net sees it.

    ValueError if the grid was not read from a photograph in cells of 32 px.
    """
    if grid.shares is None or grid.blur is None:
        raise ValueError("expected smears as SmearNetwork reads them off a photograph")
    radius = np.log(np.maximum(grid.blur[..., :1], IN_FOCUS_PX))  # 0 where nothing is seen
    return np.concatenate([np.sqrt(grid.shares), grid.blur[..., 1:], radius], axis=-1).astype(np.float32)


def of_cells(cells: Cells, blur: Floats, camera: Array) -> Floats:
    """Return what the cells (h, w) show against the camera's motion (h, w, 2), pixels: (h, w, 19).

    ``blur`` (h, w, 6) are radii and kinds, as of their `SmearGrid`. Most of it are logarithms.
    """
    seen, length, error = cells.displacement, cells.length_px, cells.error_px
    expected = np.linalg.norm(camera, axis=-1)
    apart = np.minimum(*(np.linalg.norm(seen - sign * camera, axis=-1) for sign in (1, -1)))
    scale = max(float(np.median(apart / error)), 0.5)
    cosine = np.abs((seen * camera).sum(-1)) / np.maximum(length * expected, 1e-6)
    angle = np.arccos(np.minimum(cosine, 1.0))
    readable = np.minimum(np.minimum(length, expected) / SEEN_PX, 1.0) ** 2
    one, other = (np.asarray(to_double_angle(d)) @ np.array([1, 1j]) for d in (seen, camera))
    turned = (one - other) * np.exp(-1j * np.angle(other)) / (np.abs(one) + np.abs(other) + 2)
    lines = np.zeros_like(length)  # of F, against which the network can compare, too
    evidence = [
        np.log1p(apart / (scale * error)),
        np.log1p(apart),
        readable * np.log1p(angle / np.hypot(cells.sigma_rad, 0.03)),
        np.log((length + 1) / (expected + 1)),
        lines,
        lines,
        np.log1p(length),
        np.log1p(expected),
        np.log(cells.sigma_px / (length + 2) + 0.02),
        np.log(cells.sigma_rad + 0.01),
        lines,
        turned.real,
        np.abs(turned.imag),  # only the size: mirrored pictures are alike
        np.log(blur[..., 0] + 0.5),
    ]
    return np.concatenate([np.stack(evidence, axis=-1), blur[..., 1:]], axis=-1, dtype=np.float32)


def of_places(gradients: Floats, colour: Floats, cells: Cells, camera: Array) -> Floats:
    """Return logs of gradients along and across the camera's motion and the smears, and colours."""
    double = np.concatenate([to_double_angle(camera), to_double_angle(cells.displacement)], axis=-1)
    fine = upsample_grid(double.astype(np.float32), len(gradients) // len(camera))
    values = []
    for direction in (fine[..., :2], fine[..., 2:]):
        unit = direction / np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-6)
        for octave in range(OCTAVES):
            total, c, s = np.moveaxis(gradients[..., 3 * octave : 3 * octave + 3], -1, 0)
            turned = c * unit[..., 0] + s * unit[..., 1]
            values += [np.log(0.5 * np.maximum(total + k * turned, 0) + LEAST_GRADIENT) for k in (1, -1)]
    return np.dstack([*values, colour])


def at_places(image: Floats) -> tuple[Floats, Floats]:
    """Return mean squared gradients (H/4, W/4, 9) and colours (H/4, W/4, 3) of a photograph (H, W, 3).

    RGB in [0, 1], whose sides are multiples of 32. Gradients are of each octave gx^2 + gy^2, gx^2 - gy^2 and
    2 gx gy, which turn like double angles; colours are luma and two differences.
    """
    size = image.shape[1] // PLACE_PX, image.shape[0] // PLACE_PX
    grey, gradients = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), []
    for _ in range(OCTAVES):
        dx, dy = (0.125 * cv2.Sobel(grey, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
        squares = cv2.merge([dx * dx + dy * dy, dx * dx - dy * dy, 2 * dx * dy])
        gradients.append(cv2.resize(squares, size, interpolation=cv2.INTER_AREA))
        grey = cv2.resize(grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA)
    r, g, b = np.moveaxis(cv2.resize(image, size, interpolation=cv2.INTER_AREA), -1, 0)
    return np.dstack(gradients), np.dstack([(r + g + b) / 3, r - g, b - (r + g) / 2])


def smooth_places(gradients: Floats) -> NDArray[np.bool_]:
    """Return the places about which, over a window, the picture shows nothing, of gradients (h, w, 9)."""
    side = SMOOTH_PX // PLACE_PX
    mean = cv2.blur(np.ascontiguousarray(gradients[..., 0]), (side, side))
    return np.asarray(mean < SMOOTH)
