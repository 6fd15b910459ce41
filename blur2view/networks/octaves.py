"""Octaves of a picture, each half of the one before, read by the smear network from the smallest on.

The likelihoods of an octave and of all smaller ones are joined on one axis of lengths.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from blur2view.arrays import Floats, Mask
from blur2view.networks.cepstral_peak import repeated
from blur2view.networks.model_file import OnnxNetwork
from blur2view.networks.spectra import STEP, WINDOW, polar_cepstra
from blur2view.smears.likelihood import (
    BINS,
    CANNOT_TELL,
    DIRECTIONS,
    KINDS,
    PER_OCTAVE,
    lengths_px,
    read_radii,
    softmax,
    with_unseen,
)

MAX_OCTAVES = 4  # bound, within the network's reach of 2 to 38 px; the photograph is the first
MIN_HALVED_PX = 90  # shorter side of the smallest octave: one window has 96 px
LONG_PX = 12.0  # bound, octave's pixels: a finer octave adds nothing to longer smears
SHORT_BINS = int(np.searchsorted(lengths_px(BINS), LONG_PX))
MAX_SHORT = 0.1  # bound: mean probability of shorter smears up to which the finer octave is not read
CELL_VALUES = 5 + len(KINDS)
LENGTHS = 32  # lengths of `SmearGrid.shares`: those of four octaves
FLAT_PX = 33  # side of the windows in which one grey level of 255 or less shows nothing
UNSEEN_SIGMA_PX, UNSEEN_SIGMA_RAD = 1000.0, np.pi / 2  # of cells that show nothing: constant, burnt out


class Octave(NamedTuple):
    """Logits of smears (h, w, 32, B), radii (h, w, B), kinds (h, w, 5); features (h, w, 32, C)."""

    smears: Floats
    radii: Floats
    kinds: Floats
    features: Floats


def read_octave(
    network: OnnxNetwork, features: int, grey: Floats, power: Floats, smaller: Octave | None, frugal: bool
) -> Octave:
    """Return the joint logits of an octave and all smaller ones, given its picture and its power spectra."""
    size = power.shape[:2]
    shape, coarse = (*size, DIRECTIONS, features), smaller
    if smaller is not None and smaller.radii.shape[:2] != size:
        coarse = Octave(*(repeated(values, 2)[: size[0], : size[1]] for values in smaller))
    above = np.zeros(shape, np.float32) if coarse is None else coarse.features
    outputs = network.run(grey[None], *polar_cepstra(power, network.execution.threads), above, frugal=frugal)
    expected = [(*size, DIRECTIONS, BINS), (*size, BINS), (*size, len(KINDS)), shape]
    if (shapes := [output.shape for output in outputs]) != expected:
        raise network.error(f"gives shapes {shapes}")
    own = Octave(*outputs)
    if coarse is None:
        return own
    return own._replace(smears=joined(own.smears, coarse.smears), radii=joined(own.radii, coarse.radii))


def octave_values(octave: Octave, cells: Floats, k: int) -> Floats:
    """Return values (h, w, 10) of the cells of octave ``k``, whose smears (h, w, 4) were read, in pixels.

    Double angle of the smear and both deviations, radius out of focus, probabilities of `KINDS`.
    """
    kinds = softmax(octave.kinds)
    values = np.empty((*kinds.shape[:2], CELL_VALUES), np.float32)
    values[..., :4] = with_unseen(cells, kinds[..., CANNOT_TELL])
    values[..., 4], values[..., 5:] = read_radii(octave.radii), kinds
    values[..., [0, 1, 2, 4]] *= 2**k
    return values


def with_flat(cells: Floats, blur: Floats, flat: Mask) -> tuple[Floats, Floats]:
    """Return smears (h, w, 4) and blur (h, w, 6) of cells, of which the ``flat`` ones show nothing."""
    nothing = np.array([0.0, 0.0, UNSEEN_SIGMA_PX, UNSEEN_SIGMA_RAD], np.float32)
    unknown = np.array([0.0, *np.eye(len(KINDS))[CANNOT_TELL]], np.float32)
    return np.where(flat[..., None], nothing, cells), np.where(flat[..., None], unknown, blur)


def not_short(octave: Octave) -> bool:
    """Return whether the smears are too long for a finer octave to add anything."""
    likelihood = np.exp(octave.smears - octave.smears.max((-2, -1), keepdims=True))
    short = likelihood[..., :SHORT_BINS].sum((-2, -1)) / likelihood.sum((-2, -1))
    readable = 1 - softmax(octave.kinds)[..., CANNOT_TELL]
    return bool((short * readable).sum() < MAX_SHORT * readable.sum())


def thinned(windows: Floats) -> Floats:
    """Return every third pixel of windows (h, w, 96, 96) as a picture: the network counts clipped pixels."""
    h, w = windows.shape[:2]
    every = WINDOW // STEP
    return np.ascontiguousarray(windows[:, :, 1::every, 1::every].swapaxes(1, 2)).reshape(h * STEP, w * STEP)


def octave_count(side: int) -> int:
    """Return the number of octaves of a picture whose shorter side has ``side`` pixels."""
    return min(MAX_OCTAVES, 1 + int(np.log2(max(side / MIN_HALVED_PX, 1))))


def octaves(grey: Floats, count: int) -> Iterator[tuple[int, Floats]]:
    """Yield the octaves of a picture (H, W) with their numbers, the smallest first; it is number 0."""
    levels = [grey]
    del grey  # so that its memory is freed as it is read
    for _ in range(count - 1):
        height, width = levels[-1].shape
        half = cv2.resize(levels[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(half, np.float32))
    while levels:
        yield len(levels) - 1, levels.pop()


def joined(fine: Floats, coarse: Floats) -> Floats:
    """Add logits (h, w, ..., B) of an octave and (h, w, ..., C) of all smaller ones on one axis of lengths.

    A length in the smaller octave stands one octave up the axis; the ends are repeated beyond an axis.
    """
    same = [(0, 0)] * (fine.ndim - 1)
    own = np.pad(fine, [*same, (0, coarse.shape[-1] + PER_OCTAVE - fine.shape[-1])], mode="edge")
    own += np.pad(coarse, [*same, (PER_OCTAVE, 0)], mode="edge")
    return own
