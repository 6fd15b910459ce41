"""What a network's file computes on one tile of a photograph: a grid of smears and standard deviations."""

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
from blur2view.smears.likelihood import BINS, DIRECTIONS, read_smears

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
        """Return double angle and both deviations (H / 32, W / 32, 4) of a tile (H, W, 3).

        All octaves are read, the smallest first, their logits joined, smears read off them and refined.
        """
        grey = np.asarray(cv2.cvtColor(np.ascontiguousarray(tile), cv2.COLOR_RGB2GRAY), np.float32)
        pictures = octaves(grey, levels)
        spectra = [power_spectra(picture, self.threads) for picture in pictures]
        smallest, *larger = reversed(list(zip(pictures, spectra, strict=True)))
        joint, features = self.read_octave(*smallest, None)
        for picture, power in larger:
            logits, features = self.read_octave(picture, power, features)
            joint = joined(logits, doubled(joint, logits.shape[:2]))
        return refine_on_cepstrum(read_smears(joint), spectra, self.threads)

    def read_octave(self, grey: Floats, power: Floats, coarser: Floats | None) -> tuple[Floats, Floats]:
        """Return logits (h, w, 32, 20) and features (h, w, 32, C) of an octave.

        Given its picture, its power spectra, and the features of the smaller one.
        """
        size = power.shape[:2]
        shape = (*size, DIRECTIONS, self.features)
        above = np.zeros(shape, np.float32) if coarser is None else doubled(coarser, size)
        cepstra, scales = polar_cepstra(power, self.threads)
        logits, features = self._run(grey[None, None], cepstra[None], scales[None], above[None])
        for output, expected in ((features, (1, *shape)), (logits, (1, *size, DIRECTIONS, BINS))):
            if output.shape != expected:
                raise ModelError(f"{self.path}: gives shape {output.shape} instead of {expected}; {REMEDY}")
        if not np.isfinite(logits).all():
            raise ModelError(f"{self.path}: gives values that are not finite; {REMEDY}")
        return logits[0], features[0]

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
