"""How probable it is that what a photograph shows moves by itself, given the camera's motion."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Array
from blur2view.camera.camera import Camera
from blur2view.movers.alike import alike_mean
from blur2view.movers.camera_motion import Cells, camera_field
from blur2view.movers.inputs import PLACE_PX, Picture, of_cells, of_places
from blur2view.movers.network import CELL_PX, shipped
from blur2view.movers.parts import parts_of
from blur2view.networks.model_file import Execution
from blur2view.networks.smear_network import rgb_of
from blur2view.smears.grid import SmearGrid

Floats = NDArray[np.float32]

ROUNDS = 2
"""Fits of the camera's motion, the second without what moves."""
ALIKE = 2.0
"""Weight of the mean over places of a like colour nearby, in log-odds of the place itself."""
SHIFT, SCALE = 0.95, 0.35
"""From the sum to log-odds that hold: fitted as by ``python -m tools.training.fit_parts``."""
MOST_PX = 2_500_000
"""Pixels of a photograph; larger ones are halved until they have no more."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Moving:
    """What is known of motion at places of a photograph.

    Parameters
    ----------
    odds : ndarray of shape (h, w), float32
        Log-odds that a place moves by itself, those of a like colour nearby added, not calibrated.
    moving, read : ndarray of shape (h, w), float32
        Probabilities that a place moves by itself, 0 where the picture is smooth, and that its smear is read
        right.
    part : ndarray of shape (h, w), float32
        Probability that the part a place belongs to moves by itself, 0 where nothing may.
    smooth : ndarray of shape (h, w), bool
        Places about which the picture shows nothing.
    place_px : int
        Side of a place, pixels of the photograph; together they cover it.
    camera_px : float
        Median displacement of the camera's motion, pixels.
    with_lines : bool
        Whether the smears were also measured against F, which the reduced photograph of a large one is not.
    """

    odds: Floats
    moving: Floats
    read: Floats
    part: Floats
    smooth: NDArray[np.bool_]
    place_px: int
    camera_px: float
    with_lines: bool

    def share_of(self, grid: SmearGrid, threshold: float) -> Array:
        """Return the shares (h, w) of the cells of a grid that lie in parts that move."""
        rows, columns = (-(-side * grid.stride // self.place_px) for side in grid.cells.shape[:2])
        return at_cells((self.part[:rows, :columns] >= threshold).astype(np.float32), grid.cells.shape)


def moving_probability(
    image: AnyArray,
    grid: SmearGrid,
    F: Array | None = None,
    camera: Camera | None = None,
    rng: np.random.Generator | None = None,
    execution: Execution | None = None,
) -> Moving:
    """Return what moves by itself in a photograph.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3) or (H, W)
        As of `blur2view.networks.smear_network.rgb_of`.
    grid : SmearGrid
        Its smears.
    F : ndarray of shape (3, 3), optional
        Of the camera's motion; not used where the photograph is reduced.
    camera : Camera, optional
        Whose distortion F is without.
    rng : numpy.random.Generator, optional
        Draws starts of the fit of the camera's motion; without it the camera is at rest.
    execution : Execution, optional
        What runs the network; the processor by default.
    """
    network = shipped(execution or Execution())
    factor = factor_of(grid)
    if factor > 1:
        size = -(-image.shape[1] // factor), -(-image.shape[0] // factor)
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
        F, camera = None, None
    grid = reduced(grid, factor, image.shape[:2])
    cells = Cells.of(grid, camera)
    picture = Picture(rgb_of(image), grid.cells.shape[:2], grid.stride)
    weight: Array = np.ones(cells.sigma_px.shape)
    motion = np.zeros_like(cells.displacement)
    for _ in range(1 if rng is None else ROUNDS):
        motion = motion if rng is None else camera_field(cells, weight, rng)
        odds = network.log_odds(of_places(picture, cells, motion), of_cells(cells, grid, motion, F))
        moving, read = (np.asarray(1 / (1 + np.exp(-each)), np.float32) for each in odds)
        weight = 1 - at_cells(moving, weight.shape)
    smooth = picture.smooth()
    likely = odds[0] + ALIKE * alike_mean(odds[0], picture.colour, ~smooth)
    moving = np.asarray(1 / (1 + np.exp(-SHIFT - SCALE * likely)), np.float32)
    moving[smooth] = 0
    return Moving(
        odds=likely,
        moving=moving,
        read=read,
        part=parts_of(likely, ~smooth),
        smooth=smooth,
        place_px=PLACE_PX * factor,
        camera_px=factor * float(np.median(np.linalg.norm(motion, axis=-1))),
        with_lines=F is not None,
    )


def factor_of(grid: SmearGrid) -> int:
    """Return by how much a photograph is reduced: to no more than `MOST_PX`, in cells of `CELL_PX`."""
    factor = 1
    while grid.shape[0] * grid.shape[1] > MOST_PX * factor**2 or grid.stride > CELL_PX * factor:
        factor *= 2
    return factor


def reduced(grid: SmearGrid, factor: int, shape: tuple[int, int]) -> SmearGrid:
    """Return the smears of the photograph so many times smaller, of this shape, in cells of `CELL_PX`."""
    pooled = CELL_PX * factor // grid.stride
    values = grid.cells if grid.blur is None else np.concatenate([grid.cells, grid.blur], axis=-1)
    missing = [(0, -side % pooled) for side in values.shape[:2]]
    padded = np.pad(values, [*missing, (0, 0)], mode="edge")
    rows, columns = (side // pooled for side in padded.shape[:2])
    mean = padded.reshape(rows, pooled, columns, pooled, -1).mean((1, 3), dtype=np.float32)
    mean[..., :3] /= factor
    mean[..., 4:5] /= factor
    blur = None if grid.blur is None else mean[..., 4:]
    return SmearGrid(cells=mean[..., :4], stride=CELL_PX, shape=shape, window_px=grid.window_px, blur=blur)


def at_cells(places: Floats, shape: tuple[int, ...]) -> Array:
    """Return the means (h, w) of places over cells, or their values where cells are smaller."""
    return np.asarray(cv2.resize(places, shape[1::-1], interpolation=cv2.INTER_AREA), float)
