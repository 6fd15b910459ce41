"""What moves by itself in a photograph, and whether the camera moved.

Two networks say so of every 4 x 4 pixels: the U-Net by what the photograph looks like, the other by how its
blur departs from the camera's motion, which is one smooth field through the smears of what the U-Net takes
for still. Their log-odds add, as of independent evidence, and places of a like colour nearby share them. How
high log-odds stand differs between photographs, so a part reaches from the highest of the photograph halfway
down to its median.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Array
from blur2view.movers.camera_motion import camera_field
from blur2view.movers.evidence import PLACE_PX, Cells, Picture, cell_values, of_cells, of_places
from blur2view.networks.model_file import BLUR, UNET, Execution, shipped
from blur2view.networks.octave_reader import LARGE_PX, LENGTHS
from blur2view.networks.protocol import Detail
from blur2view.networks.smear_network import SmearNetwork, floats_of, gain_of, rgb_of
from blur2view.networks.spectra import STEP
from blur2view.smears.grid import SmearGrid
from blur2view.smears.likelihood import DIRECTIONS, PER_OCTAVE

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

SLOPE, INTERCEPT = 0.7, 0.4
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
place 10 of 56 sharp photographs have a mask instead of 4, and 8 % more of rendered movers are named."""
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
    """What moves by itself in a photograph, at its places.

    Parameters
    ----------
    log_odds : ndarray of shape (h, w), float32
        That a place moves by itself.
    smooth : ndarray of shape (h, w), bool
        Places about which the picture shows nothing.
    place_px : int
        Side of a place, pixels of the photograph; together they cover it.
    camera_px : float
        Median displacement of the camera's motion, pixels.
    camera_moved : float
        Probability that the camera moved.
    """

    log_odds: Floats
    smooth: Mask
    place_px: int
    camera_px: float
    camera_moved: float

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
        count, part = cv2.connectedComponents(
            (seen & (height > EDGE_HEIGHT)).astype(np.uint8), connectivity=4
        )
        moves = np.zeros(count, bool)
        moves[part[seen & (height > TOP_HEIGHT) & (sigmoid(self.log_odds) >= threshold)]] = True
        moves[0] = False
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
        As of `blur2view.networks.smear_network.rgb_of`.
    grid : SmearGrid
        Its smears; those of another network than `SmearNetwork` are read anew.
    rng : numpy.random.Generator
        Draws starts of the fit of the camera's motion.
    execution : Execution, optional
        What runs the networks; the processor by default.

    Raises
    ------
    ModelError
        If a network cannot be run.
    """
    execution = execution or Execution()
    if grid.shares is None or grid.blur is None:  # of another network, which does not say what the U-Net sees
        reader = SmearNetwork(threads=execution.threads, providers=execution.providers)
        grid = reader.predict(image, detail=Detail.GEOMETRY)
    factor = factor_of(grid)
    if factor > 1:
        size = -(-image.shape[1] // factor), -(-image.shape[0] // factor)
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    grid = reduced(grid, factor, image.shape[:2])
    missing = [(0, -side % STEP) for side in image.shape[:2]]
    shown = np.pad(floats_of(image, gain_of(image)), [*missing, (0, 0)], mode="symmetric")
    looks, moved = shipped(UNET, execution).run(first_axis(shown), first_axis(cell_values(grid)))
    del shown
    cells, picture = Cells.of(grid), Picture(rgb_of(image), grid.cells.shape[:2], grid.stride)
    low, high = np.quantile(looks, [0.5, 0.995])
    likely = np.clip((at_cells(looks, grid.cells.shape) - low) / max(high - low, 1.0), 0, 1)
    motion = camera_field(cells, 1 - (1 - LEFT) * likely, rng)
    camera_px = factor * float(np.median(np.linalg.norm(motion, axis=-1)))
    camera_moved = float(sigmoid(float(moved) + 2 * np.log(max(camera_px, 0.1) / PLAIN_PX)))
    if camera_moved < 0.5:
        motion, camera_px = np.zeros_like(motion), 0.0
    seen = of_places(picture, cells, motion), of_cells(cells, grid, motion)
    ((blurred, _),) = shipped(BLUR, execution).run(*map(first_axis, seen))
    smooth, odds = picture.smooth(), INTERCEPT + SLOPE * (looks + blurred)
    odds += np.float32(AT_REST * (1 - camera_moved))
    return Moving(
        log_odds=(1 - ALIKE) * odds + ALIKE * bilateral_mean(odds, picture.colour, ~smooth),
        smooth=smooth,
        place_px=PLACE_PX * factor,
        camera_px=camera_px,
        camera_moved=camera_moved,
    )


def bilateral_mean(values: Floats, colour: Floats, known: NDArray[np.bool_]) -> Floats:
    """Return the mean (h, w) of the values (h, w) that are known, over places nearby of a like colour.

    A bilateral filter as wide as objects are. Places are gathered in bins of colour and position, all of
    which are weighed against each other (Chen, Paris and Durand, Real-time edge-aware image processing with
    the bilateral grid, SIGGRAPH 2007), and the means follow the picture's edges.

    Parameters
    ----------
    values : ndarray of shape (h, w)
    colour : ndarray of shape (h, w, 3)
        Luma and two differences of colours, levels in [0, 1], as of `evidence.Picture`.
    known : ndarray of shape (h, w), bool
        Places whose values have a say.
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


def factor_of(grid: SmearGrid) -> int:
    """Return by how much a photograph is reduced: to no more than `LARGE_PX`, in cells of `STEP` pixels."""
    factor = 1
    while grid.shape[0] * grid.shape[1] > LARGE_PX * factor**2 or grid.stride > STEP * factor:
        factor *= 2
    return factor


def reduced(grid: SmearGrid, factor: int, shape: tuple[int, ...]) -> SmearGrid:
    """Return the smears of the photograph so many times smaller, of this shape, in cells of `STEP` pixels.

    ``factor`` is a power of two. Smears that were read of photographs only.
    """
    if grid.blur is None or grid.shares is None:
        raise ValueError("expected smears as SmearNetwork reads them off a photograph")
    pooled = STEP * factor // grid.stride
    shorter = PER_OCTAVE * (pooled.bit_length() - 1)  # lengths that are bin 0 of the smaller picture
    lengths = grid.shares[..., DIRECTIONS:]
    lengths = np.concatenate(
        [lengths[..., : shorter + 1].sum(-1)[..., None], lengths[..., shorter + 1 :]], -1
    )
    lengths = np.pad(lengths, [(0, 0), (0, 0), (0, LENGTHS - lengths.shape[-1])])
    values = np.concatenate([grid.cells, grid.blur, grid.shares[..., :DIRECTIONS], lengths], axis=-1)
    missing = [(0, -side % pooled) for side in values.shape[:2]]
    padded = np.pad(values, [*missing, (0, 0)], mode="edge")
    rows, columns = (side // pooled for side in padded.shape[:2])
    mean = padded.reshape(rows, pooled, columns, pooled, -1).mean((1, 3), dtype=np.float32)
    mean[..., [0, 1, 2, 4]] /= factor
    cells, blur, shares = np.split(mean, [4, 4 + grid.blur.shape[-1]], axis=-1)
    return SmearGrid(
        cells=cells,
        stride=STEP,
        shape=(shape[0], shape[1]),
        window_px=grid.window_px,
        blur=blur,
        shares=shares,
    )


def at_cells(places: Floats, shape: tuple[int, ...]) -> Array:
    """Return the means (h, w) of places over cells, or their values where cells are smaller."""
    return np.asarray(cv2.resize(places, shape[1::-1], interpolation=cv2.INTER_AREA), float)
