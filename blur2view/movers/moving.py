"""Which blocks of a photograph move by themselves, and whether the camera moved.

A block has 4 x 4 pixels. Two networks judge it: ``models/unet.onnx`` sees the photograph and the cells of its
`SmearGrid`; ``models/movers.onnx`` sees the cells against the camera's motion, one smooth field through the
smears of the blocks that the U-Net takes for still, and gradients along that motion's blur, which are weak
where only the camera moved. Their log-odds add, as those of independent evidence do, and are shared among
near blocks of like colour. Their level differs between photographs, so a part reaches from the photograph's
highest log-odds halfway to its median.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Array, Floats, Mask
from blur2view.images.pixels import as_rgb, brightened, brightness_gain
from blur2view.networks.model_file import MOVERS, UNET, Execution, shipped
from blur2view.networks.octaves import LENGTHS
from blur2view.networks.smear_network import READ_WHOLE_PX, SmearNetwork
from blur2view.networks.spectra import STEP
from blur2view.smears.camera_motion import Movers, has_moved, moved_probability
from blur2view.smears.grid import SmearGrid, to_double_angle, upsample_grid
from blur2view.smears.likelihood import BOTH, CANNOT_TELL, DIRECTIONS, IN_FOCUS_PX, KINDS, SHARP, SMEARED

BLOCK_PX = 4
"""Side of a block, pixels."""
CELL_VALUES = DIRECTIONS + LENGTHS + len(KINDS) + 1
"""Values of a cell for the U-Net: `cell_values`."""
MIN_STATED_PX, FLOOR_PX, FLOOR_SHARE = 0.1, 0.4, 0.05
"""Least deviation of a smear, pixels; errors beside it: constant, and per pixel of length; bounds."""
SEEN_PX = 2.0
"""Length from which on a smear's direction counts fully, pixels; bound."""
OCTAVES, MIN_GRADIENT = 3, 1e-5
"""Octaves in which gradients are measured; their least mean square, of levels in [0, 1] a pixel."""
SMOOTH, SMOOTH_WINDOW_PX = 1.5e-6, 96
"""Mean square gradient, a third of a level of 255 a pixel, below which a window of this side, as the smears
are read in, shows nothing; bound."""
SAMPLES, SCORED, STEPS = 150, 400, 12
"""Triples of cells that start the camera's field, cells that score them, reweighted steps; bounds."""
SIGNS = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]], float)
RIDGE, RIDGE_SHARE = 0.3, 0.3
"""Weight, in cells, of each quadratic coefficient of the field over this share of the median length."""
LEFT = 0.05
"""Weight, in the fit of the camera's motion, of the blocks with the highest log-odds; bound."""
SLOPE, INTERCEPT = 0.7, 0.5
"""From the sum of both networks, shared, to calibrated log-odds: logistic regression on scenes of both
renderers has 0.66 and 0.58, on DAVIS 0.89 and 2.0; photographs without movers pull the other way."""
ALIKE = 2 / 3
"""Weight of the mean over near blocks of like colour; the block itself has the rest."""
LUMA, COLOUR, NEAR, BIN = 0.07, 0.025, 0.13, 1.5
"""Deviations of that mean's weights: luma, differences of colours, position as a share of the width; side of
a bin, deviations."""
ROWS, EDGE_BLOCKS, EDGE_EPS = 1000, 3, 1e-2
"""Bins weighed at a time, which bounds the memory; radius, blocks, and epsilon of OpenCV's guided filter."""
AT_REST = 1.0
"""Log-odds added before a camera that stands still, which smears nothing itself (with 2 instead 10 of 56
sharp photographs had a mask instead of 4, and 8 % more of rendered movers were named)."""
EDGE_HEIGHT, TOP_HEIGHT, THRESHOLD = 0.5, 0.8, 0.5
"""Heights between the median and the highest log-odds of a photograph, of a part's edge and of its top, and
the probability of its top. `tools.evaluation.segmentation`, by every second photograph, chose these and
NEAR."""

SHARPER, SMEARED_SHARE = 0.1, 0.1
"""Before a camera that stands still: by how much the sharpness of a part, 0 to 1, must exceed that of what is
around it, and the share of its blocks that must be smeared for it to move nevertheless. Of 24 sharp cut-outs
before soft photographs these leave a mask on 1, not 3, and of 138 sharp photographs on 8, not 11; no mask of
24 rendered scenes with movers before a still camera changes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Moving:
    """The blocks of a photograph that move by themselves, and its camera's motion."""

    log_odds: Floats
    """(h, w), that a block moves by itself."""
    smooth: Mask
    """(h, w): blocks about which the picture shows nothing."""
    block_px: float
    """Side of a block, pixels of the photograph; together they cover it. Whole numbers, if a mask is made."""
    camera_px: float
    """Median displacement of the camera's motion, pixels."""
    camera_moved: float
    """Probability that the camera moved."""
    kinds: Floats
    """(h, w, 3): probabilities that a block is sharp, that it is smeared, and that its blur is known."""

    @property
    def probability(self) -> Floats:
        """Probability (h, w) that a block moves by itself, 0 where the picture is smooth."""
        return np.asarray(np.where(self.smooth, 0, sigmoid(self.log_odds)), np.float32)

    def parts(self, threshold: float = THRESHOLD) -> Mask:
        """Mark the blocks (h, w) of connected parts that move: the top of each has this probability."""
        textured = ~self.smooth
        if not textured.any():
            return np.zeros(textured.shape, bool)
        low, high = np.median(self.log_odds[textured]), self.log_odds[textured].max()
        height = (self.log_odds - low) / max(high - low, 1e-6)
        edge = (textured & (height > EDGE_HEIGHT)).astype(np.uint8)
        count, part = cv2.connectedComponents(edge, connectivity=4)
        moves = np.zeros(count, bool)
        moves[part[textured & (height > TOP_HEIGHT) & (sigmoid(self.log_odds) >= threshold)]] = True
        if not has_moved(self.camera_moved):
            moves &= ~self._in_focus(part, count)
        return np.asarray(moves[part])

    def _in_focus(self, part: NDArray[np.int32], count: int) -> Mask:
        """Mark the parts (count,) that are sharper than what is around them, part 0, and hold no sure smear.

        Before a camera that stands still these are the subject of a lens, not what moves.
        """
        sharp, smeared, readable = np.moveaxis(self.kinds, -1, 0)

        def mean(values: AnyArray, weight: AnyArray) -> Array:
            total = np.bincount(part.ravel(), (values * weight).ravel(), count)
            return np.asarray(total / np.maximum(np.bincount(part.ravel(), weight.ravel(), count), 1e-6))

        sharpness = mean(np.minimum(sharp / np.maximum(readable, 1e-6), 1), readable)
        smears = mean(smeared > 0.5 * readable, np.ones_like(readable))
        return np.asarray((sharpness > sharpness[0] + SHARPER) & (smears < SMEARED_SHARE))

    def evidence(self, grid: SmearGrid, share: float) -> Movers:
        """Return what this says of the blur of a photograph, of which a ``share`` moves by itself."""
        rows, columns = (int(-(-side * grid.stride // self.block_px)) for side in grid.cells.shape[:2])
        cells = over_cells(self.parts()[:rows, :columns].astype(np.float32), grid.cells.shape)
        return Movers(cells=cells, share=share, camera_moved=self.camera_moved)


def moving_in(
    image: AnyArray, grid: SmearGrid, rng: np.random.Generator, execution: Execution | None = None
) -> Moving:
    """Return what moves by itself in a photograph.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3) or (H, W)
        As `blur2view.images.pixels.as_photograph` returns it; reduced until a cell has 32 pixels or, if
        smears are read anew, while it has more than `READ_WHOLE_PX`.
    grid : SmearGrid
        Its smears; they are read anew unless a `SmearNetwork` read them, closer than in ``Detail.RANKING``.
    rng : numpy.random.Generator
        Draws starts of the fit of the camera's motion.
    execution : Execution, optional
        Threads and providers of the networks. ModelError if they cannot be run.
    """
    execution = execution or Execution()
    image, grid, factor = _readable(image, grid, execution)
    gain = brightness_gain(image)
    missing = [(0, -side % STEP) for side in image.shape[:2]]
    image = np.pad(as_rgb(image), [*missing, (0, 0)], mode="symmetric")
    gradients, colour = block_gradients(image)
    unet_inputs = channels_first(brightened(image, gain)), channels_first(cell_values(grid))
    looks, camera_odds = shipped(UNET, execution).run(*unet_inputs)
    low, high = np.quantile(looks, [0.5, 0.995])
    mover_share = np.clip((over_cells(looks, grid.cells.shape) - low) / max(high - low, 1.0), 0, 1)
    motion = camera_field(grid, 1 - (1 - LEFT) * mover_share, rng)
    camera_px = factor * float(np.median(np.linalg.norm(motion, axis=-1)))
    camera_moved = moved_probability(grid, float(camera_odds), camera_px)
    if not has_moved(camera_moved):
        motion, camera_px = np.zeros_like(motion), 0.0
    mover_inputs = block_evidence(gradients, colour, grid, motion), cell_evidence(grid, motion)
    (blurred,) = shipped(MOVERS, execution).run(*map(channels_first, mover_inputs))
    odds = np.asarray(INTERCEPT + SLOPE * (looks + blurred), np.float32)
    odds += np.float32(AT_REST * (1 - camera_moved))
    smooth = smooth_blocks(gradients)
    kinds = np.asarray(grid.kinds, np.float32)
    shares = np.dstack([kinds[..., SHARP], kinds[..., [SMEARED, BOTH]].sum(-1), 1 - kinds[..., CANNOT_TELL]])
    return Moving(
        log_odds=(1 - ALIKE) * odds + ALIKE * bilateral_mean(odds, colour, ~smooth),
        smooth=smooth,
        block_px=BLOCK_PX * factor,
        camera_px=camera_px,
        camera_moved=camera_moved,
        kinds=np.asarray(cv2.resize(shares, smooth.shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32),
    )


def _readable(image: AnyArray, grid: SmearGrid, execution: Execution) -> tuple[AnyArray, SmearGrid, float]:
    """Return a photograph at the size that the networks read, its grid there, and the factor between both."""
    if grid.shares is not None and grid.blur is not None and grid.stride >= STEP:
        scale = grid.stride / STEP
        return reduced(image, scale), reduced_grid(grid), scale
    factor = 1
    while image.shape[0] * image.shape[1] > READ_WHOLE_PX * factor**2 or grid.stride > STEP * factor:
        factor *= 2
    image = reduced(image, factor)
    grid = SmearNetwork(threads=execution.threads, providers=execution.providers).predict(image)
    return image, grid, factor


def reduced(image: AnyArray, factor: float) -> AnyArray:
    """Return a photograph whose sides are those of another over a factor, rounded up."""
    if factor == 1:
        return image
    size = int(-(-image.shape[1] // factor)), int(-(-image.shape[0] // factor))
    while image.shape[0] >= 4 * size[1] and not (image.shape[0] % 2 or image.shape[1] % 2):
        half = image.shape[1] // 2, image.shape[0] // 2  # which OpenCV does in a twelfth of the time
        image = cv2.resize(image, half, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def reduced_grid(grid: SmearGrid) -> SmearGrid:
    """Return the grid of a photograph that is `reduced` until a cell has 32 pixels: of the same cells."""
    if (factor := grid.stride / STEP) == 1:
        return grid
    assert grid.blur is not None
    cells, blur = grid.cells.copy(), grid.blur.copy()
    cells[..., :3] /= factor  # the fourth, an angle, stays
    blur[..., 0] /= factor
    rows, columns = (int(-(-side // factor)) for side in grid.shape)
    window_px = None if grid.window_px is None else int(grid.window_px // factor)
    return replace(grid, cells=cells, blur=blur, stride=STEP, shape=(rows, columns), window_px=window_px)


def camera_field(grid: SmearGrid, weight: Array, rng: np.random.Generator) -> Array:
    """Return the displacement (h, w, 2) that the camera's motion gives every cell of a grid, pixels.

    A quadratic polynomial of the position, as instantaneous rotations and planes give it. The sign of a smear
    is the one nearer to the field. Affine fields through three cells each, in every choice of signs, are
    starts, which ``rng`` draws; that of least Geman-McClure cost is refined by reweighted least squares.
    ``weight`` (h, w), 0 to 1, is small where something moves by itself.
    """
    displacement, _, error = _smears(grid)
    smears, sigma, cell_weight = displacement.reshape(-1, 2), error.ravel(), weight.ravel()
    size = np.array(grid.shape[::-1])
    x, y = (grid.points().reshape(-1, 2) - (size - 1) / 2).T / (max(size) / 2)
    basis, model = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1), np.zeros((6, 2))
    model[:3] = _start(basis[:, :3], smears, sigma, cell_weight, rng)
    length = RIDGE_SHARE * max(float(np.median(np.linalg.norm(smears, axis=1))), 1.0)
    ridge = np.diag(np.array([0, 0, 0, 1, 1, 1]) * RIDGE / length**2 + 1e-9)
    for _ in range(STEPS):
        predicted = basis @ model
        signed_smears = np.where((predicted * smears).sum(axis=1, keepdims=True) < 0, -smears, smears)
        squared = ((signed_smears - predicted) ** 2).sum(axis=1) / (4 * sigma**2)
        weighted_basis = basis * (cell_weight / (1 + squared) ** 2 / sigma**2)[:, None]
        model = np.linalg.solve(weighted_basis.T @ basis + ridge, weighted_basis.T @ signed_smears)
    return np.asarray((basis @ model).reshape(displacement.shape))


def _smears(grid: SmearGrid) -> tuple[Array, Array, Array]:
    """Return the smears (h, w, 2) of a grid's cells, and their stated and whole deviations (h, w), pixels."""
    smears = grid.smears()
    displacement = smears.displacement.astype(float)
    sigma = np.maximum(smears.sigma_px.astype(float), MIN_STATED_PX)
    error = np.hypot(sigma, FLOOR_PX + FLOOR_SHARE * np.linalg.norm(displacement, axis=-1))
    return displacement, sigma, error


def _start(basis: Array, smears: Array, sigma: Array, weight: Array, rng: np.random.Generator) -> Array:
    """Return the field (3, 2) of least cost, affine through three cells or constant as one of them."""
    share = weight / sigma
    share = share / share.sum() if share.sum() > 0 else np.full(len(smears), 1 / len(smears))
    triples = rng.choice(len(smears), (SAMPLES, 3), p=share)
    inverse = np.linalg.pinv(basis[triples], rcond=1e-3)  # (S, 3, 3)
    signed_smears = smears[triples][:, None] * SIGNS[None, :, :, None]  # (S, 4, 3, 2)
    constant = np.zeros((SAMPLES, 3, 2))
    constant[:, 0] = smears[triples[:, 0]]
    models = np.concatenate([(inverse[:, None] @ signed_smears).reshape(-1, 3, 2), constant])
    scored = rng.permutation(len(smears))[:SCORED]
    x, y = (models[..., k] @ basis[scored].T for k in (0, 1))  # (M, SCORED)
    seen_x, seen_y = smears[scored].T
    squared = x * x + y * y + (seen_x**2 + seen_y**2) - 2 * np.abs(x * seen_x + y * seen_y)
    error = squared / (4 * sigma[scored] ** 2)
    cost = (weight[scored] / sigma[scored] * error / (1 + error)).sum(axis=1)
    return np.asarray(models[np.argmin(cost)])


def cell_values(grid: SmearGrid) -> Floats:
    """Return the U-Net's values (h, w, 70) of the cells of a grid that a photograph was read into.

    Square roots of the shares of directions and lengths, probabilities of the kinds of blur, logarithm of
    the radius out of focus. ValueError if another network read the grid, or in cells of other than 32 px.
    """
    if grid.shares is None or grid.blur is None:
        raise ValueError("expected smears as SmearNetwork reads them off a photograph")
    radius = np.log(np.maximum(grid.blur[..., :1], IN_FOCUS_PX))  # a radius of 0 says that none is seen
    return np.concatenate([np.sqrt(grid.shares), grid.blur[..., 1:], radius], axis=-1).astype(np.float32)


def cell_evidence(grid: SmearGrid, camera: Array) -> Floats:
    """Return how the smears of a grid's cells differ from the camera's motion (h, w, 2), pixels.

    Values (h, w, 16), most of them logarithms; u and v are the double-angle vectors of smear and camera as
    complex numbers, (u - v) / v is the difference along v and across it, made small where both are short.
    """
    assert grid.blur is not None
    smears, sigma_px, error = _smears(grid)
    sigma_rad = np.minimum(grid.smears().sigma_rad.astype(float), np.pi / 2)
    smear_length, camera_length = np.linalg.norm(smears, axis=-1), np.linalg.norm(camera, axis=-1)
    distance = np.minimum(*(np.linalg.norm(smears - sign * camera, axis=-1) for sign in (1, -1)))
    scale = max(float(np.median(distance / error)), 0.5)
    cosine = np.abs((smears * camera).sum(-1)) / np.maximum(smear_length * camera_length, 1e-6)
    angle = np.arccos(np.minimum(cosine, 1.0))
    readable = np.minimum(np.minimum(smear_length, camera_length) / SEEN_PX, 1.0) ** 2
    u, v = (np.asarray(to_double_angle(d)) @ np.array([1, 1j]) for d in (smears, camera))
    difference = (u - v) * np.exp(-1j * np.angle(v)) / (np.abs(u) + np.abs(v) + 2)
    evidence = [
        np.log1p(distance / (scale * error)),
        np.log1p(distance),
        readable * np.log1p(angle / np.hypot(sigma_rad, 0.03)),
        np.log((smear_length + 1) / (camera_length + 1)),
        np.log1p(smear_length),
        np.log1p(camera_length),
        np.log(sigma_px / (smear_length + 2) + 0.02),
        np.log(sigma_rad + 0.01),
        difference.real,
        np.abs(difference.imag),  # mirroring a photograph changes the sign, which therefore says nothing
        np.log(grid.blur[..., 0] + 0.5),
    ]
    return np.concatenate([np.stack(evidence, axis=-1), grid.blur[..., 1:]], axis=-1, dtype=np.float32)


def block_evidence(gradients: Floats, colour: Floats, grid: SmearGrid, camera: Array) -> Floats:
    """Return values (h, w, 15) of blocks: logarithms of gradients along and across motions, and colours.

    Gradients and colours are those of `block_gradients`; the motions are the camera's (h/8, w/8, 2) and the
    grid's smears.
    """
    double = np.concatenate([to_double_angle(d) for d in (camera, _smears(grid)[0])], axis=-1)
    fine = upsample_grid(double.astype(np.float32), len(gradients) // len(camera))
    values = []
    for direction in (fine[..., :2], fine[..., 2:]):
        unit = direction / np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-6)
        for octave in range(OCTAVES):
            total, c, s = np.moveaxis(gradients[..., 3 * octave : 3 * octave + 3], -1, 0)
            turned = c * unit[..., 0] + s * unit[..., 1]
            values += [np.log(0.5 * np.maximum(total + k * turned, 0) + MIN_GRADIENT) for k in (1, -1)]
    return np.dstack([*values, colour])


def block_gradients(image: Floats) -> tuple[Floats, Floats]:
    """Return mean squared gradients (H/4, W/4, 9) and colours (H/4, W/4, 3) of a photograph (H, W, 3).

    RGB in [0, 1], whose sides are multiples of 32. Gradients are of each octave gx^2 + gy^2, gx^2 - gy^2 and
    2 gx gy, which turn like double angles; colours are luma and two differences.
    """
    size = image.shape[1] // BLOCK_PX, image.shape[0] // BLOCK_PX
    grey, gradients = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), []
    for _ in range(OCTAVES):
        dx, dy = (0.125 * cv2.Sobel(grey, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
        squares = cv2.merge([dx * dx + dy * dy, dx * dx - dy * dy, 2 * dx * dy])
        gradients.append(cv2.resize(squares, size, interpolation=cv2.INTER_AREA))
        grey = cv2.resize(grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA)
    r, g, b = np.moveaxis(cv2.resize(image, size, interpolation=cv2.INTER_AREA), -1, 0)
    return np.dstack(gradients), np.dstack([(r + g + b) / 3, r - g, b - (r + g) / 2])


def smooth_blocks(gradients: Floats) -> Mask:
    """Mark the blocks (h, w) about which a window shows nothing, by `block_gradients` (h, w, 9)."""
    side = SMOOTH_WINDOW_PX // BLOCK_PX
    mean = cv2.blur(np.ascontiguousarray(gradients[..., 0]), (side, side))
    return np.asarray(mean < SMOOTH)


def bilateral_mean(values: Floats, colour: Floats, valid: Mask) -> Floats:
    """Return the mean (h, w) of the known values (h, w) over near blocks of like colour.

    A bilateral filter as wide as objects are. Blocks are gathered in bins of colour (h, w, 3), of levels in
    [0, 1] as `block_gradients` returns it, and position, all of which are weighed against each other (Chen,
    Paris and Durand, Real-time edge-aware image processing with the bilateral grid, SIGGRAPH 2007), and the
    means follow the picture's edges.
    """
    y, x = np.mgrid[: values.shape[0], : values.shape[1]] / (NEAR * values.shape[1])
    features = np.dstack([colour / np.array([LUMA, COLOUR, COLOUR]), x, y]).reshape(-1, 5)
    bins = np.round(features / BIN).astype(np.int64)
    bins -= bins.min(axis=0)
    numbers = np.ravel_multi_index(tuple(bins.T), tuple(bins.max(axis=0) + 1))
    _, index = np.unique(numbers, return_inverse=True)

    def total(weights: NDArray[np.generic]) -> Floats:
        return np.bincount(index, weights.ravel()).astype(np.float32)

    count, among = np.bincount(index).astype(np.float32), total(valid)
    sums = total(np.where(valid, values, 0))
    means = np.stack([total(column) for column in features.T], axis=1) / count[:, None]
    half = (means**2).sum(axis=1) / 2
    average = np.empty_like(sums)
    for first in range(0, len(means), ROWS):
        some = slice(first, first + ROWS)
        weights = np.exp(np.minimum(means[some] @ means.T - half[some, None] - half, 0))
        average[some] = (weights @ sums) / np.maximum(weights @ among, 1e-3)
    binned = np.ascontiguousarray(average[index].reshape(values.shape))
    return np.asarray(cv2.ximgproc.guidedFilter(colour, binned, EDGE_BLOCKS, EDGE_EPS), np.float32)


def channels_first(channels: Floats) -> Floats:
    """Return values (h, w, C) as (C, h, w)."""
    return np.ascontiguousarray(np.moveaxis(channels, -1, 0))


def sigmoid(log_odds: AnyArray | float) -> Array:
    """Return probabilities of log-odds."""
    return np.asarray(1 / (1 + np.exp(-np.clip(log_odds, -30, 30))))


def over_cells(blocks: Floats, shape: tuple[int, ...]) -> Array:
    """Return the means (h, w) of blocks over cells, or their values where cells are smaller."""
    return np.asarray(cv2.resize(blocks, shape[1::-1], interpolation=cv2.INTER_AREA), float)
