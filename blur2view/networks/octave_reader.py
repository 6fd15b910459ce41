"""What a network's file computes on one piece of a photograph: a grid of smears and of the kinds of blur."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blur2view.errors import ModelError
from blur2view.networks.cepstral_peak import refine_on_cepstrum
from blur2view.networks.model_file import INPUTS, REMEDY, ModelInfo, patient, session_errors
from blur2view.networks.octaves import doubled, joined, octaves
from blur2view.networks.spectra import STEP, WINDOW, polar_cepstra, power_spectra, windows_of
from blur2view.smears.blur_kinds import CANNOT_TELL, KINDS, read_radii, softmax
from blur2view.smears.likelihood import BINS, DIRECTIONS, lengths_px, read_smears, with_unseen

Floats = NDArray[np.float32]

LEAST_PX = 64
"""Least side of the smallest octave: two cells, more than its mirrored border."""
LONG_PX = 12.0
"""Length, in an octave's pixels, from which on a finer one says no more."""
SHORT_BINS = int(np.searchsorted(lengths_px(BINS), LONG_PX))
MAY_BE_SHORT, LEAST_TOLD = 0.1, 0.04
"""Probability of shorter smears, in the mean over all cells that can tell, from which on it is read all the
same; and the share of the cells that must tell their blur."""
PIXELS = [0, 1, 2, 4]
"""Values of a cell that are pixels."""


class Octave(NamedTuple):
    """Logits of smears (h, w, 32, B), radii (h, w, B) and kinds (h, w, 5), and features (h, w, 32, C).

    Lengths and radii on one axis, for an octave and all smaller ones.
    """

    smears: Floats
    radii: Floats
    kinds: Floats
    features: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """What is read of a picture.

    Attributes
    ----------
    values : ndarray of shape (h, w, 10), float32
        Double angle and both deviations of smears, radius out of focus, probabilities of the kinds of blur.
    features : ndarray of shape (h, w, 32, C), float32
        Of the finest octave that was read.
    stride : int
        Pixels a cell.
    """

    values: Floats
    features: Floats
    stride: int


class OctaveReader:
    """A network that reads the likelihood of smears in one octave, given the smaller one.

    Cell j of its grid is centred at pixel 32 j + 15.5.
    """

    def __init__(self, path: Path, session: Any, info: ModelInfo) -> None:
        self.path, self.session, self.features = path, session, info.features
        self.threads = session.get_session_options().intra_op_num_threads

    def read(self, grey: Floats, levels: int, apart: int = 0) -> Reading:
        """Return what is read of a picture (H, W) whose sides are multiples of the largest cells'.

        Its octaves are read, the smallest first, their logits joined, smears read off them and refined. If
        cells are to be ``apart`` pixels wide, 32 times a power of two, finer octaves have no more windows,
        and are read only while smears may be too short for those that were.
        """
        spectra, joint = list[Floats](), list[Octave]()
        for k, picture in reversed(list(enumerate(octaves(grey, levels)))):
            windows = windows_of(picture, max(STEP, apart >> k))
            spectra.insert(0, power_spectra(windows, self.threads))
            shown = picture if apart >> k <= STEP else thinned(windows)
            joint.append(self.read_octave(shown, spectra[0], joint[-1] if joint else None))
            if STEP << k <= apart and not_short(joint[-1]):
                break
        read = joint[-1]
        kinds = softmax(read.kinds)
        cells = refine_on_cepstrum(read_smears(read.smears), spectra, self.threads)
        cells = with_unseen(cells, kinds[..., CANNOT_TELL])
        values = np.concatenate([cells, read_radii(read.radii)[..., None], kinds], -1)
        values[..., PIXELS] *= 2**k
        return Reading(values=values, features=read.features, stride=apart or STEP)

    def read_octave(self, grey: Floats, power: Floats, smaller: Octave | None) -> Octave:
        """Return what an octave and all smaller ones say, given its picture and its power spectra."""
        size = power.shape[:2]
        shape = (*size, DIRECTIONS, self.features)
        coarse = None if smaller is None else Octave(*(doubled(one, size) for one in smaller))
        above = np.zeros(shape, np.float32) if coarse is None else coarse.features
        cepstra, scales = polar_cepstra(power, self.threads)
        outputs = self._run(grey[None, None], cepstra[None], scales[None], above[None])
        shapes = (*size, DIRECTIONS, BINS), (*size, BINS), (*size, len(KINDS)), shape
        for output, expected in zip(outputs, shapes, strict=True):
            if output.shape != (1, *expected):
                raise ModelError(
                    f"{self.path}: gives shape {output.shape} instead of {(1, *expected)}; {REMEDY}"
                )
        if not all(np.isfinite(output).all() for output in outputs[:3]):
            raise ModelError(f"{self.path}: gives values that are not finite; {REMEDY}")
        own = Octave(*(output[0] for output in outputs))
        if coarse is None:
            return own
        smears, radii = joined(own.smears, coarse.smears), joined(own.radii, coarse.radii)
        return own._replace(smears=smears, radii=radii)

    def _run(self, *inputs: Floats) -> list[Floats]:
        """Return the network's outputs; ModelError if it cannot be run."""
        height, width = inputs[0].shape[2:]
        with patient(height * width // STEP**2) as options:
            try:
                outputs: list[Floats] = self.session.run(
                    None, dict(zip(INPUTS, inputs, strict=True)), options
                )
            except session_errors():
                why = "takes too long" if options.terminate else "cannot be run"
                raise ModelError(f"{self.path}: {why} on {width}x{height} pixels; {REMEDY}") from None
        return outputs


def not_short(read: Octave) -> bool:
    """Return whether smears are too long for a finer octave to tell more of them."""
    likelihood = np.exp(read.smears - read.smears.max((-2, -1), keepdims=True))
    short = likelihood[..., :SHORT_BINS].sum((-2, -1)) / likelihood.sum((-2, -1))
    told = 1 - softmax(read.kinds)[..., CANNOT_TELL]
    return bool(told.mean() >= LEAST_TOLD and (short * told).sum() < MAY_BE_SHORT * told.sum())


def thinned(windows: Floats) -> Floats:
    """Return a picture (32 h, 32 w) of every third pixel of windows (h, w, 96, 96).

    A network sees in it what share of each window is white or black; nothing else.
    """
    h, w = windows.shape[:2]
    every = WINDOW // STEP
    return np.ascontiguousarray(windows[:, :, 1::every, 1::every].swapaxes(1, 2)).reshape(h * STEP, w * STEP)
