"""What moves by itself in a photograph, and whether the camera moved.

Two networks say so of every 4 x 4 pixels: the U-Net by what the photograph looks like, the other by how its
blur departs from the camera's motion, one smooth field through the smears of what the U-Net takes for still.
Their log-odds add, as of independent evidence, and places of a like colour nearby share them. How high they
stand differs between photographs, so a part reaches from the photograph's highest halfway to its median.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Array
from blur2view.images.pixels import brightened, gain_of, rgb_of
from blur2view.movers.evidence import (
    PLACE_PX,
    Cells,
    at_places,
    camera_field,
    cell_values,
    of_cells,
    of_places,
    smooth_places,
)
from blur2view.networks.model_file import BLUR, UNET, Execution, shipped
from blur2view.networks.octave_reader import LARGE_PX
from blur2view.networks.smear_network import SmearNetwork
from blur2view.networks.spectra import STEP
from blur2view.smears.grid import SmearGrid

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

SLOPE, INTERCEPT = 0.7, 0.5
"""From the sum of both, shared, to log-odds that hold: logistic regression on scenes of both renderers has
0.66 and 0.58, on DAVIS 0.89 and 2.0; photographs without movers pull the other way."""
ALIKE = 2 / 3
"""Weight of the mean over places nearby of a like colour; the place itself has the rest."""
LEFT = 0.05
"""Weight, in the fit of the camera's motion, of what looks most like moving."""
EDGE_HEIGHT, TOP_HEIGHT = 0.5, 0.8
"""Heights between the median and the highest log-odds of a photograph: of a part's edge, and what each part
must reach. Chosen, as NEAR, on every second photograph; tools/results/segmentation.md has the others."""
AT_REST = 1.0
"""Log-odds in favour of moving before a camera that stands still, which smears nothing itself. With 2 in its
place 10 of 56 sharp photographs had a mask instead of 4, and 8 % more of rendered movers were named."""
THRESHOLD = 0.5
"""Probability that the highest place of a part must reach."""
PLAIN_PX = 4.0
"""Length of the camera's motion that speaks neither for nor against it: of half of the rendered and real
photographs of tools/results/segmentation.md it errs in the fewest."""
LUMA, COLOUR, NEAR = 0.07, 0.025, 0.13
"""Standard deviations of the weights: luma, differences of colours, and position as a share of the width."""
BIN = 1.5
"""Side of a bin, standard deviations."""
EDGE_PLACES, EDGE_EPS = 3, 1e-2
"""Radius of the windows in which averages follow the picture's edges, places; OpenCV's epsilon."""
ROWS = 1000
"""Bins that are weighed at a time, which bounds the memory."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Moving:
    """What moves by itself in a photograph, at its places."""

    log_odds: Floats
    """(h, w), that a place moves by itself."""
    smooth: Mask
    """(h, w): places about which the picture shows nothing."""
    place_px: int
    """Side of a place, pixels of the photograph; together they cover it."""
    camera_px: float
    """Median displacement of the camera's motion, pixels."""
    camera_moved: float
    """Probability that the camera moved."""

    @property
    def probability(self) -> Floats:
        """Probability (h, w) that a place moves by itself, 0 where the picture is smooth."""
        return np.asarray(np.where(self.smooth, 0, sigmoid(self.log_odds)), np.float32)

    def parts(self, threshold: float = THRESHOLD) -> Mask:
        """Mark the places (h, w) of connected parts that move: one at least of each has this probability."""
        seen = ~self.smooth
        if not seen.any():
            return np.zeros(seen.shape, bool)
        low, high = np.median(self.log_odds[seen]), self.log_odds[seen].max()
        height = (self.log_odds - low) / max(high - low, 1e-6)
        edge = (seen & (height > EDGE_HEIGHT)).astype(np.uint8)
        count, part = cv2.connectedComponents(edge, connectivity=4)
        moves = np.zeros(count, bool)
        moves[part[seen & (height > TOP_HEIGHT) & (sigmoid(self.log_odds) >= threshold)]] = True
        return np.asarray(moves[part])

    def share_of(self, grid: SmearGrid) -> Array:
        """Return the shares (h, w) of the cells of a grid that lie in parts that move."""
        rows, columns = (-(-side * grid.stride // self.place_px) for side in grid.cells.shape[:2])
        return at_cells(self.parts()[:rows, :columns].astype(np.float32), grid.cells.shape)


def moving_in(
    image: AnyArray, grid: SmearGrid, rng: np.random.Generator, execution: Execution | None = None
) -> Moving:
    """Return what moves by itself in a photograph.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3) or (H, W)
        As of `blur2view.images.pixels.photograph_of`; with more than `LARGE_PX` it is halved.
    grid : SmearGrid
        Its smears. They are read anew of a halved photograph, or where another network read them.
    rng : numpy.random.Generator
        Draws starts of the fit of the camera's motion.
    execution : Execution, optional
        What runs the networks, which raise ModelError if they cannot be run.
    """
    execution, factor = execution or Execution(), 1
    while image.shape[0] * image.shape[1] > LARGE_PX * factor**2 or grid.stride > STEP * factor:
        factor *= 2
    if factor > 1:
        size = -(-image.shape[1] // factor), -(-image.shape[0] // factor)
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    if factor > 1 or grid.shares is None or grid.blur is None:
        grid = SmearNetwork(threads=execution.threads, providers=execution.providers).predict(image)
    assert grid.blur is not None
    gain = gain_of(image)
    missing = [(0, -side % STEP) for side in image.shape[:2]]
    image = np.pad(rgb_of(image), [*missing, (0, 0)], mode="symmetric")
    gradients, colour = at_places(image)
    seen = first_axis(brightened(image, gain)), first_axis(cell_values(grid))
    looks, moved = shipped(UNET, execution).run(*seen)
    cells, smooth = Cells.of(grid), smooth_places(gradients)
    low, high = np.quantile(looks, [0.5, 0.995])
    likely = np.clip((at_cells(looks, grid.cells.shape) - low) / max(high - low, 1.0), 0, 1)
    motion = camera_field(grid, 1 - (1 - LEFT) * likely, rng)
    camera_px = factor * float(np.median(np.linalg.norm(motion, axis=-1)))
    camera_moved = float(sigmoid(float(moved) + 2 * np.log(max(camera_px, 0.1) / PLAIN_PX)))
    if camera_moved < 0.5:
        motion, camera_px = np.zeros_like(motion), 0.0
    against = of_places(gradients, colour, cells, motion), of_cells(cells, grid.blur, motion)
    ((blurred, _),) = shipped(BLUR, execution).run(*map(first_axis, against))
    odds = INTERCEPT + SLOPE * (looks + blurred)
    odds += np.float32(AT_REST * (1 - camera_moved))
    return Moving(
        log_odds=(1 - ALIKE) * odds + ALIKE * bilateral_mean(odds, colour, ~smooth),
        smooth=smooth,
        place_px=PLACE_PX * factor,
        camera_px=camera_px,
        camera_moved=camera_moved,
    )


def bilateral_mean(values: Floats, colour: Floats, known: Mask) -> Floats:
    """Return the mean (h, w) of the values (h, w) that are known, over places nearby of a like colour.

    A bilateral filter as wide as objects are. Places are gathered in bins of colour (h, w, 3), of levels in
    [0, 1] as of `evidence.at_places`, and position, all of which are weighed against each other (Chen, Paris
    and Durand, Real-time edge-aware image processing with the bilateral grid, SIGGRAPH 2007), and the means
    follow the picture's edges.
    """
    y, x = np.mgrid[: values.shape[0], : values.shape[1]] / (NEAR * values.shape[1])
    places = np.dstack([colour / np.array([LUMA, COLOUR, COLOUR]), x, y]).reshape(-1, 5)
    bins = np.round(places / BIN).astype(np.int64)
    bins -= bins.min(axis=0)
    numbers = np.ravel_multi_index(tuple(bins.T), tuple(bins.max(axis=0) + 1))
    _, index = np.unique(numbers, return_inverse=True)

    def total(weights: NDArray[np.generic]) -> Floats:
        return np.bincount(index, weights.ravel()).astype(np.float32)

    count, among = np.bincount(index).astype(np.float32), total(known)
    sums = total(np.where(known, values, 0))
    means = np.stack([total(column) for column in places.T], axis=1) / count[:, None]
    half = (means**2).sum(axis=1) / 2
    average = np.empty_like(sums)
    for first in range(0, len(means), ROWS):
        some = slice(first, first + ROWS)
        weights = np.exp(np.minimum(means[some] @ means.T - half[some, None] - half, 0))
        average[some] = (weights @ sums) / np.maximum(weights @ among, 1e-3)
    binned = np.ascontiguousarray(average[index].reshape(values.shape))
    return np.asarray(cv2.ximgproc.guidedFilter(colour, binned, EDGE_PLACES, EDGE_EPS), np.float32)


def first_axis(channels: Floats) -> Floats:
    """Return values (h, w, C) as (C, h, w)."""
    return np.ascontiguousarray(np.moveaxis(channels, -1, 0))


def sigmoid(log_odds: AnyArray | float) -> Array:
    """Return probabilities of log-odds."""
    return np.asarray(1 / (1 + np.exp(-np.clip(log_odds, -30, 30))))


def at_cells(places: Floats, shape: tuple[int, ...]) -> Array:
    """Return the means (h, w) of places over cells, or their values where cells are smaller."""
    return np.asarray(cv2.resize(places, shape[1::-1], interpolation=cv2.INTER_AREA), float)
