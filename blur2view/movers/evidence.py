"""Inputs of the two networks that find what moves by itself.

``models/unet.onnx`` sees the photograph and what the smear network says of its cells. ``models/movers.onnx``
sees smears against the camera's motion and, as these are read in windows of three cells' width, gradients
along the direction in which that motion blurs: they are weak where only the camera moved, and not where an
object stood still with respect to it, or moved elsewhere. So one input lies on cells, the other on places of
4 x 4 pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Array
from blur2view.networks.octave_reader import LENGTHS
from blur2view.networks.spectra import STEP
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
STRIP = 8
"""Rows of cells at a time, which bounds the memory."""
LEAST_GRADIENT = 1e-5
"""Mean square, of levels in [0, 1] a pixel."""
SMOOTH = 1.5e-6
"""Mean square gradient below which a window shows nothing: a third of a level of 255 a pixel."""
SMOOTH_PX = 96
"""Side of the windows that may show nothing: those the smears are read in."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Cells:
    """The smears of a grid.

    Parameters
    ----------
    points : ndarray of shape (h, w, 2)
        Their centres (x, y), pixels.
    displacement : ndarray of shape (h, w, 2)
        Pixels, of either sign.
    sigma_px, sigma_rad : ndarray of shape (h, w)
        Standard deviations of the end-point error and of the direction.
    shape : (int, int)
        Height and width of the photograph.
    """

    points: Array
    displacement: Array
    sigma_px: Array
    sigma_rad: Array
    shape: tuple[int, int]

    @classmethod
    def of(cls, grid: SmearGrid) -> Cells:
        """Return the cells of a grid."""
        smears = grid.smears()
        return cls(
            points=grid.points(),
            displacement=smears.displacement.astype(float),
            sigma_px=np.maximum(smears.sigma_px.astype(float), LEAST_PX),
            sigma_rad=np.minimum(smears.sigma_rad.astype(float), np.pi / 2),
            shape=grid.shape,
        )

    @property
    def length_px(self) -> Array:
        """Lengths (h, w)."""
        return np.asarray(np.linalg.norm(self.displacement, axis=-1))

    @property
    def error_px(self) -> Array:
        """Standard deviations (h, w) with the errors that no cell states."""
        return np.hypot(self.sigma_px, FLOOR_PX + FLOOR_SHARE * self.length_px)

    def apart_px(self, motion: Array) -> Array:
        """Return how far smears of either sign are from a motion (h, w, 2), (h, w), pixels."""
        signed = (np.linalg.norm(self.displacement - sign * motion, axis=-1) for sign in (1, -1))
        return np.asarray(np.minimum(*signed))

    def departure(self, motion: Array) -> Array:
        """Return the same in standard deviations."""
        return self.apart_px(motion) / self.error_px


def cell_values(grid: SmearGrid) -> Floats:
    """Return what the smear network says of the cells of a grid, (h, w, 70), as the U-Net sees it.

    Raises
    ------
    ValueError
        If the grid was not read from a photograph, or its cells have other than `STEP` pixels.
    """
    if grid.shares is None or grid.blur is None or grid.stride != STEP:
        raise ValueError("expected smears as SmearNetwork reads them off a photograph")
    radius = np.log(np.maximum(grid.blur[..., :1], IN_FOCUS_PX))  # 0 where nothing is seen
    return np.concatenate([np.sqrt(grid.shares), grid.blur[..., 1:], radius], axis=-1).astype(np.float32)


def of_cells(cells: Cells, grid: SmearGrid, camera: Array) -> Floats:
    """Return what the smears and kinds of blur of the cells show, (h, w, K), most of it logarithms.

    Parameters
    ----------
    cells : Cells
        Of the same grid, (h, w).
    grid : SmearGrid
    camera : ndarray of shape (h, w, 2)
        Displacements of the camera's motion, pixels.

    Raises
    ------
    ValueError
        If the grid has no kinds of blur.
    """
    if grid.blur is None:
        raise ValueError("expected smears as SmearNetwork reads them off a photograph")
    seen, length, error = cells.displacement, cells.length_px, cells.error_px
    expected = np.linalg.norm(camera, axis=-1)
    apart = cells.apart_px(camera)
    scale = max(float(np.median(cells.departure(camera))), 0.5)
    cosine = np.abs((seen * camera).sum(-1)) / np.maximum(length * expected, 1e-6)
    angle = np.arccos(np.minimum(cosine, 1.0))
    readable = np.minimum(np.minimum(length, expected) / SEEN_PX, 1.0) ** 2
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
        *np.moveaxis(_turned_difference(seen, camera), -1, 0),
    ]
    kinds = [np.log(grid.blur[..., 0] + 0.5), *np.moveaxis(grid.blur[..., 1:], -1, 0)]
    return np.stack([*evidence, *kinds], axis=-1).astype(np.float32)


def _turned_difference(seen: Array, camera: Array) -> Array:
    """Return seen less expected smears (h, w, 2) in double angle, turned to the expected direction, relative.

    Of the second component only the size: mirrored pictures are alike.
    """
    one, other = (np.asarray(to_double_angle(d)) @ np.array([1, 1j]) for d in (seen, camera))
    apart = (one - other) * np.exp(-1j * np.angle(other)) / (np.abs(one) + np.abs(other) + 2)
    return np.stack([apart.real, np.abs(apart.imag)], axis=-1)


def of_places(picture: Picture, cells: Cells, camera: Array) -> Floats:
    """Return gradients along and across the camera's motion and the smears, and colours, (H/4, W/4, 15).

    Gradients are logarithms of mean squares, of every octave. Of cells (h, w) there are 8 h rows.
    """
    zoom = picture.gradients.shape[0] // camera.shape[0]
    double = np.concatenate([to_double_angle(camera), to_double_angle(cells.displacement)], axis=-1)
    fine = upsample_grid(double.astype(np.float32), zoom)
    blur = [_along_and_across(picture.gradients, fine[..., k : k + 2]) for k in (0, 2)]
    return np.concatenate([*blur, picture.colour], axis=-1)


def _along_and_across(gradients: Floats, direction: AnyArray) -> Floats:
    """Return logs of mean squared gradients along and across directions in double angle, (..., 2 OCTAVES)."""
    unit = direction / np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-6)
    logs = []
    for octave in range(OCTAVES):
        total, c, s = np.moveaxis(gradients[..., 3 * octave : 3 * octave + 3], -1, 0)
        turned = c * unit[..., 0] + s * unit[..., 1]
        logs += [np.log(0.5 * np.maximum(total + sign * turned, 0) + LEAST_GRADIENT) for sign in (1, -1)]
    return np.stack(logs, axis=-1)


class Picture:
    """Mean squared gradients and colours of a photograph at places of 4 x 4 pixels.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3), float32
        RGB in [0, 1].
    shape : (int, int)
        Rows and columns (h, w) of the cells, which may reach beyond it.
    stride : int
        Pixels on a cell's side.

    Attributes
    ----------
    gradients : ndarray of shape (h stride / 4, w stride / 4, 3 OCTAVES)
        Of each octave gx^2 + gy^2, gx^2 - gy^2 and 2 gx gy: rotated like double angles.
    colour : ndarray of shape (h stride / 4, w stride / 4, 3)
        Luma, and two differences of colours.
    """

    def __init__(self, image: Floats, shape: tuple[int, int], stride: int) -> None:
        self._zoom = stride // PLACE_PX
        strips = []
        for first in range(0, shape[0], STRIP):
            above, below = max(first - 1, 0), min(first + STRIP + 1, shape[0])
            part = np.ascontiguousarray(image[above * stride : below * stride])
            missing = (below - above) * stride - part.shape[0], shape[1] * stride - part.shape[1]
            part = np.pad(part, ((0, missing[0]), (0, missing[1]), (0, 0)), mode="symmetric")
            rows = slice(self._zoom * (first - above), self._zoom * (min(first + STRIP, shape[0]) - above))
            strips.append(_at_places(part, (self._zoom * (below - above), self._zoom * shape[1]))[rows])
        places = np.concatenate(strips)
        self.gradients, self.colour = np.split(places, [3 * OCTAVES], axis=-1)

    def smooth(self) -> NDArray[np.bool_]:
        """Return the places about which, over a window, the picture shows nothing."""
        side = SMOOTH_PX // PLACE_PX
        mean = cv2.blur(np.ascontiguousarray(self.gradients[..., 0]), (side, side))
        return np.asarray(mean < SMOOTH)


def _at_places(part: Floats, shape: tuple[int, int]) -> Floats:
    """Return the gradients and colours of a strip (H, W, 3), at places (rows, columns) that divide it."""
    size = shape[::-1]
    grey = cv2.cvtColor(part, cv2.COLOR_RGB2GRAY)
    layers = []
    for _ in range(OCTAVES):
        dx, dy = (0.125 * cv2.Sobel(grey, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
        squares = np.dstack([dx * dx + dy * dy, dx * dx - dy * dy, 2 * dx * dy])
        layers.append(cv2.resize(squares, size, interpolation=cv2.INTER_AREA))
        grey = cv2.resize(grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA)
    r, g, b = np.moveaxis(cv2.resize(part, size, interpolation=cv2.INTER_AREA), -1, 0)
    layers.append(np.dstack([(r + g + b) / 3, r - g, b - (r + g) / 2]))
    return np.concatenate(layers, axis=-1, dtype=np.float32)
