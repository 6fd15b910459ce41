"""What a network's file computes on one tile of a photograph: a grid of smears and of the kinds of blur."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.errors import ModelError
from blur2view.networks.cepstral_peak import refine_on_cepstrum
from blur2view.networks.model_file import INPUTS, REMEDY, ModelInfo, patient, session_errors
from blur2view.networks.octaves import doubled, joined, octaves
from blur2view.networks.spectra import STEP, polar_cepstra, power_spectra
from blur2view.smears.blur_kinds import CANNOT_TELL, KINDS, read_radii, softmax
from blur2view.smears.likelihood import BINS, DIRECTIONS, read_smears, with_unseen

Floats = NDArray[np.float32]

LEAST_PX = 64
"""Least side of the smallest octave: two cells, more than its mirrored border."""


class OctaveReader:
    """A network that reads the likelihood of smears in one octave, given the smaller one.

    Cell j of its grid is centred at pixel 32 j + 15.5.
    """

    def __init__(self, path: Path, session: Any, info: ModelInfo) -> None:
        self.path, self.session, self.features = path, session, info.features
        self.threads = session.get_session_options().intra_op_num_threads

    def read(self, tile: Floats, levels: int) -> Floats:
        """Return what is read of a tile (H, W, 3), (H / 32, W / 32, 10).

        Double angle and both deviations of smears; radius out of focus; probabilities of the kinds of blur.
        All octaves are read, the smallest first, their logits joined, smears read off them and refined.
        """
        grey = np.asarray(cv2.cvtColor(np.ascontiguousarray(tile), cv2.COLOR_RGB2GRAY), np.float32)
        pictures = octaves(grey, levels)
        spectra = [power_spectra(picture, self.threads) for picture in pictures]
        smallest, *larger = reversed(list(zip(pictures, spectra, strict=True)))
        smears, radii, kinds, features = self.read_octave(*smallest, None)
        for picture, power in larger:
            fine, fine_radii, kinds, features = self.read_octave(picture, power, features)
            smears, radii = (
                joined(own, doubled(coarse, own.shape[:2]))
                for own, coarse in ((fine, smears), (fine_radii, radii))
            )
        told = softmax(kinds)
        cells = refine_on_cepstrum(read_smears(smears), spectra, self.threads)
        cells = with_unseen(cells, told[..., CANNOT_TELL])
        return np.concatenate([cells, read_radii(radii)[..., None], told], -1)

    def read_octave(self, grey: Floats, power: Floats, coarser: Floats | None) -> tuple[Floats, ...]:
        """Return logits and features of an octave.

        Of smears (h, w, 32, 20), radii (h, w, 20), kinds (h, w, 5); features (h, w, 32, C). Given its
        picture, its power spectra, and the features of the smaller one.
        """
        size = power.shape[:2]
        shape = (*size, DIRECTIONS, self.features)
        above = np.zeros(shape, np.float32) if coarser is None else doubled(coarser, size)
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
        return tuple(output[0] for output in outputs)

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
