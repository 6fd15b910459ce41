"""What a network's file computes on a photograph: its octaves, each half the size of the one before.

Their likelihoods are joined on one axis of lengths, and smears and kinds of blur are read off it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.networks.cepstral_peak import refine_on_cepstrum, repeated
from blur2view.networks.model_file import OnnxNetwork
from blur2view.networks.spectra import STEP, WINDOW, in_batches, polar_cepstra, power_spectra, windows_of
from blur2view.smears.likelihood import (
    BINS,
    CANNOT_TELL,
    DIRECTIONS,
    KINDS,
    PER_OCTAVE,
    lengths_px,
    read_radii,
    read_smears,
    shares_of,
    softmax,
    with_unseen,
)

Floats = NDArray[np.float32]

LEVELS = 4  # sizes at most, the photograph's own included, within the network's reach of 2 to 38 px
SMALLEST_PX = 90  # copies with a side below this are not made: a window of the network has 96 px
LEAST_PX = 64  # least side of the smallest octave: two cells, more than its mirrored border
# Pixels up to which every window is read; larger photographs are halved for what moves by itself, and after
# a larger octave a network gives its memory back.
LARGE_PX = 2_500_000
LONG_PX = 12.0  # length, in an octave's pixels, from which on a finer one says no more
SHORT_BINS = int(np.searchsorted(lengths_px(BINS), LONG_PX))
MAY_BE_SHORT = 0.1  # mean probability of shorter smears from which on it is read all the same
ROWS = 4  # of cells, whose likelihoods are read at a time: a core's cache holds them
LENGTHS = 32  # lengths whose shares are stated: those of the longest axis, of four octaves
VALUES = 5 + len(KINDS) + DIRECTIONS + LENGTHS  # of a cell


class Octave(NamedTuple):
    """Logits of smears (h, w, 32, B), radii (h, w, B), kinds (h, w, 5); features (h, w, 32, C)."""

    smears: Floats
    radii: Floats
    kinds: Floats
    features: Floats


def read_octaves(
    network: OnnxNetwork, features: int, pictures: Iterator[tuple[int, Floats]], apart: int
) -> Floats:
    """Return what is read of `octaves` of a picture, (h, w, 74), whose sides are multiples of large cells'.

    The smallest first; finer ones only while smears may be too short for those that were. Cells are
    ``apart`` pixels wide, 32 times a power of two. Double angle and both deviations of smears, radius out of
    focus, probabilities of the kinds of blur; shares of directions and lengths, where cells have 32 pixels.
    """
    threads, spectra, read = network.execution.threads, list[Floats](), None
    for k, picture in pictures:
        windows = windows_of(picture, max(STEP, apart >> k))
        spectra.insert(0, power_spectra(windows, threads))
        shown, frugal = picture if apart >> k <= STEP else thinned(windows), picture.size > LARGE_PX
        del picture, windows  # a large photograph's
        read = read_octave(network, features, shown, spectra[0], read, frugal)
        if k and STEP << k <= apart and not_short(read):
            break
    assert read is not None
    kinds = softmax(read.kinds)
    values = np.zeros((*kinds.shape[:2], VALUES), np.float32)

    def decode(rows: slice) -> None:
        values[rows, :, :4] = read_smears(read.smears[rows])
        if apart == STEP:
            values[rows, :, -DIRECTIONS - LENGTHS :] = shares_of(read.smears[rows], LENGTHS)

    in_batches(decode, len(values), threads, ROWS)
    cells = refine_on_cepstrum(values[..., :4], spectra, threads)
    values[..., :4] = with_unseen(cells, kinds[..., CANNOT_TELL])
    values[..., 4], values[..., 5 : 5 + len(KINDS)] = read_radii(read.radii), kinds
    values[..., [0, 1, 2, 4]] *= 2**k  # which are pixels
    return values


def read_octave(
    network: OnnxNetwork, features: int, grey: Floats, power: Floats, smaller: Octave | None, frugal: bool
) -> Octave:
    """Return what an octave and all smaller ones say, given its picture and its power spectra."""
    size = power.shape[:2]
    shape, coarse = (*size, DIRECTIONS, features), smaller
    if smaller is not None and smaller.radii.shape[:2] != size:
        coarse = Octave(*(repeated(one, 2)[: size[0], : size[1]] for one in smaller))
    above = np.zeros(shape, np.float32) if coarse is None else coarse.features
    outputs = network.run(grey[None], *polar_cepstra(power, network.execution.threads), above, frugal=frugal)
    expected = [(*size, DIRECTIONS, BINS), (*size, BINS), (*size, len(KINDS)), shape]
    if (found := [output.shape for output in outputs]) != expected:
        raise network.error(f"gives shapes {found}")
    own = Octave(*outputs)
    if coarse is None:
        return own
    return own._replace(smears=joined(own.smears, coarse.smears), radii=joined(own.radii, coarse.radii))


def not_short(read: Octave) -> bool:
    """Return whether smears are too long for a finer octave to tell more of them."""
    likelihood = np.exp(read.smears - read.smears.max((-2, -1), keepdims=True))
    short = likelihood[..., :SHORT_BINS].sum((-2, -1)) / likelihood.sum((-2, -1))
    known = 1 - softmax(read.kinds)[..., CANNOT_TELL]
    return bool((short * known).sum() < MAY_BE_SHORT * known.sum())


def thinned(windows: Floats) -> Floats:
    """Return every third pixel of windows (h, w, 96, 96), of which a network sees what share is clipped."""
    h, w = windows.shape[:2]
    every = WINDOW // STEP
    return np.ascontiguousarray(windows[:, :, 1::every, 1::every].swapaxes(1, 2)).reshape(h * STEP, w * STEP)


def octave_count(side: int) -> int:
    """Return how many sizes of a picture are read, by its shorter side."""
    return min(LEVELS, 1 + int(np.log2(max(side / SMALLEST_PX, 1))))


def octaves(grey: Floats, count: int) -> Iterator[tuple[int, Floats]]:
    """Yield copies of a picture (H, W), 2 x 2 pixels averaged, the smallest first, and it, with number 0."""
    levels = [grey]
    del grey  # what was given is not kept
    for _ in range(count - 1):
        height, width = levels[-1].shape
        half = cv2.resize(levels[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(half, np.float32))
    while levels:
        yield len(levels) - 1, levels.pop()


def joined(fine: Floats, coarse: Floats) -> Floats:
    """Return one octave's logits (h, w, ..., B) plus those of all smaller ones (h, w, ..., C), on one axis.

    A length of the smaller copy is one octave up the axis; what no octave can read has one logit.
    """
    same = [(0, 0)] * (fine.ndim - 1)
    own = np.pad(fine, [*same, (0, coarse.shape[-1] + PER_OCTAVE - fine.shape[-1])], mode="edge")
    own += np.pad(coarse, [*same, (PER_OCTAVE, 0)], mode="edge")
    return own
