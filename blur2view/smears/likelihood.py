"""Smears read off a likelihood over direction and length: displacements and standard deviations.

There are 32 bins of direction over 180 degrees, and bins of length, four an octave from 2 px on, with one
before them for anything shorter and one after them for anything longer. The likelihood was fitted to the true
smear blurred by a Gaussian of 0.6 bins, so a smear is read between bins: as the mean about the highest peak,
or of the whole likelihood where no peak stands out.
"""

from __future__ import annotations

import numpy as np

from blur2view.arrays import Floats

DIRECTIONS = 32  # bins over 180 degrees; bin k is the direction 180 k / 32 degrees from x towards y
PER_OCTAVE = 4  # bins of length an octave
SHORTEST_PX = 2.0  # length of bin 1
BINS = 20  # of length in one octave: anything shorter, 2 to 38 px, anything longer
STILL_PX = 0.4  # length of bin 0, of anything shorter: most of these are no smear at all
LABEL_SPREAD = 0.6  # standard deviation, in bins, of the Gaussian that blurred the truth
PEAK_BINS = 2  # bins on each side of the peak whose mean is the smear
# Probability about the peak from which the mean about it is the smear; below, the mean of the whole has the
# smaller error (tools/results/training_log.md, 20 test photographs).
SURE_PEAK = 0.6
ANY_PX = 16.0  # of an unseen smear: root mean square of lengths of 2 to 38 px, uniform in their logarithm
MIN_READ_SIGMA_RAD, MIN_READ_SIGMA_PX = float(np.deg2rad(0.3)), 0.15  # bins resolve no less
# Kinds of blur that a cell may show, in the order of the network's logits.
KINDS = ("sharp", "out of focus", "smeared", "out of focus and smeared", "cannot tell")
SHARP, OUT_OF_FOCUS, SMEARED, BOTH, CANNOT_TELL = range(len(KINDS))
# Radius of bin 1; bins are four an octave, bin 0 is for anything smaller, the last one for anything larger. A
# radius is that of the disc which spreads as widely as lens and camera do.
SMALLEST_RADIUS_PX = 0.7
IN_FOCUS_PX = 0.5  # radius of bin 0


def lengths_px(bins: int, first_px: float = SHORTEST_PX, below_px: float = STILL_PX) -> Floats:
    """Return the lengths (bins,), pixels: ``below_px`` of bin 0, then four an octave from ``first_px``."""
    lengths = first_px * 2.0 ** ((np.arange(bins) - 1) / PER_OCTAVE)
    lengths[0] = below_px
    return lengths.astype(np.float32)


def radii_px(bins: int) -> Floats:
    """Return the radii (bins,), pixels, of the bins."""
    return lengths_px(bins, SMALLEST_RADIUS_PX, IN_FOCUS_PX)


def normalised(log_likelihood: Floats) -> Floats:
    """Return probabilities (..., 32, bins) of directions and lengths, given logarithms up to a constant."""
    likelihood = np.exp(log_likelihood - log_likelihood.max((-2, -1), keepdims=True))
    return np.asarray(likelihood / likelihood.sum((-2, -1), keepdims=True), likelihood.dtype)


def read_smears(log_likelihood: Floats) -> Floats:
    """Return the smears (h, w, 4), float32, of log likelihoods (h, w, 32, bins), up to a constant.

    Double angle |d| (cos 2phi, sin 2phi), pixels; standard deviation of the end-point error |d - d*|, pixels;
    standard deviation of the direction, radians. These are root mean squares over the whole likelihood, less
    the variance of the Gaussian that blurred the truth.
    """
    likelihood = normalised(log_likelihood)
    direction, length = _smears(likelihood)
    apart = np.pi / DIRECTIONS * np.arange(DIRECTIONS, dtype=np.float32) - direction[..., None]
    apart = np.remainder(apart + np.pi / 2, np.pi) - np.pi / 2
    bins = lengths_px(log_likelihood.shape[-1])
    blur_rad, blur_log = LABEL_SPREAD * np.pi / DIRECTIONS, LABEL_SPREAD * np.log(2) / PER_OCTAVE
    direction_variance = (likelihood.sum(-1) * apart**2).sum(-1) - blur_rad**2
    # E|d - d*|^2 = E L*^2 + L^2 - 2 L E L* |cos(phi - phi*)|
    along = ((likelihood @ bins) * np.abs(np.cos(apart))).sum(-1)
    squared = likelihood.sum(-2) @ bins**2 + length**2 - 2 * length * along
    squared -= length**2 * (blur_rad**2 + blur_log**2)
    sigma_rad = np.sqrt(np.maximum(direction_variance, MIN_READ_SIGMA_RAD**2))
    sigma_px = np.sqrt(np.maximum(squared, MIN_READ_SIGMA_PX**2))
    return np.stack(
        [length * np.cos(2 * direction), length * np.sin(2 * direction), sigma_px, sigma_rad], -1
    ).astype(np.float32)


def marginals(log_likelihood: Floats, lengths: int, octaves: float = 0.0) -> Floats:
    """Return the probabilities of 32 directions and of ``lengths`` lengths, (h, w, 32 + lengths).

    Of log likelihoods (h, w, 32, bins); the last length includes all longer ones. Lengths are those in a
    picture which is smaller by so many ``octaves``.
    """
    likelihood = normalised(log_likelihood)
    each = likelihood.sum(-2)
    if octaves:
        each = each @ _reduced_lengths(each.shape[-1], octaves)
    missing = [(0, 0)] * (each.ndim - 1) + [(0, max(lengths - each.shape[-1], 0))]
    each = np.pad(each, missing)
    each[..., lengths - 1] = each[..., lengths - 1 :].sum(-1)
    return np.concatenate([likelihood.sum(-1), each[..., :lengths]], axis=-1)


def _reduced_lengths(bins: int, octaves: float) -> Floats:
    """Return the linear map of lengths (bins,) to those in a picture which is smaller by some octaves."""
    at = np.maximum(np.arange(bins) - PER_OCTAVE * octaves, 0.0)
    at[0] = 0.0
    below = at.astype(int)
    shares = np.zeros((bins, below.max() + 2), np.float32)
    shares[np.arange(bins), below] = 1 - (at - below)
    shares[np.arange(bins), below + 1] = at - below
    return shares


def with_unseen(cells: Floats, unseen: Floats) -> Floats:
    """Return smears (h, w, 4) whose deviations include any smear, with probability ``unseen`` (h, w)."""
    x, y, sigma_px, sigma_rad = np.moveaxis(cells, -1, 0)
    any_px = x**2 + y**2 + ANY_PX**2
    sigmas = [
        np.sqrt((1 - unseen) * sigma_px**2 + unseen * any_px),
        np.sqrt((1 - unseen) * sigma_rad**2 + unseen * np.float32(np.pi**2 / 12)),
    ]
    return np.stack([x, y, *sigmas], -1).astype(np.float32)


def _smears(likelihood: Floats) -> tuple[Floats, Floats]:
    """Return directions, radians, and lengths, pixels, (h, w) each, of likelihoods (h, w, 32, bins)."""
    direction, length, mass = _peak(likelihood)
    bins = lengths_px(likelihood.shape[-1])
    doubled = 2 * np.pi / DIRECTIONS * np.arange(DIRECTIONS, dtype=np.float32)
    weight = likelihood @ bins  # (h, w, 32): the mean double angle is of displacements, not of directions
    x, y = weight @ np.cos(doubled), weight @ np.sin(doubled)
    mean = np.arctan2(y, x) / 2
    # geometric mean of both: the mean length is too long where nothing moves, the mean displacement too short
    # where directions are uncertain (24 development scenes, Kodak: tools/results/training_log.md)
    mean_length = np.sqrt(weight.sum(-1) * np.hypot(x, y))
    sure = mass >= SURE_PEAK
    return np.where(sure, direction, mean), np.where(sure, length, mean_length)


def _peak(likelihood: Floats) -> tuple[Floats, Floats, Floats]:
    """Return direction (radians) and length (px) of the mean about the highest peak, and its probability."""
    bins = likelihood.shape[-1]
    wide = sum(np.roll(likelihood, shift, -2) for shift in (-1, 0, 1))
    wide = np.pad(wide, [(0, 0)] * 3 + [(1, 1)])
    smooth = wide[..., :-2] + wide[..., 1:-1] + wide[..., 2:]  # sums of 3 x 3 bins are steadier
    row, column = np.divmod(smooth.reshape(*smooth.shape[:2], -1).argmax(-1), bins)
    steps = np.arange(-PEAK_BINS, PEAK_BINS + 1)
    rows = (row[..., None, None] + steps[:, None]) % DIRECTIONS
    columns = column[..., None, None] + steps
    inside = (columns >= 0) & (columns < bins)
    flat = likelihood.reshape(*likelihood.shape[:2], -1)
    index = (rows * bins + np.clip(columns, 0, bins - 1)).reshape(*row.shape, -1)
    near = np.take_along_axis(flat, index, -1).reshape(*row.shape, len(steps), len(steps)) * inside
    mass = np.maximum(near.sum((-2, -1)), 1e-12)
    direction = (row + (near.sum(-1) @ steps) / mass) * (np.pi / DIRECTIONS)
    position = column + (near.sum(-2) @ steps) / mass
    log_length = np.interp(position, np.arange(bins), np.log(lengths_px(bins)))
    return direction.astype(np.float32), np.exp(log_length).astype(np.float32), mass


def softmax(logits: Floats) -> Floats:
    """Return probabilities of logits (..., n)."""
    values = np.exp(logits - logits.max(-1, keepdims=True))
    return np.asarray(values / values.sum(-1, keepdims=True), np.float32)


def read_radii(logits: Floats) -> Floats:
    """Return the radii out of focus (h, w), pixels, of logits (h, w, bins): geometric means."""
    return np.asarray(np.exp(softmax(logits) @ np.log(radii_px(logits.shape[-1]))), np.float32)
