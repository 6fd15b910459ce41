"""A small network over places of the picture that weighs the evidence: that they move, that they are read.

What half cells show goes down to quarters of a cell and is joined there by what the picture shows. Of every
quarter the smear is guessed in between, for training has truth of that everywhere, of movers seldom. All
returns to half cells, whose ever larger neighbourhoods are looked at, and goes down once more. The 50 000
coefficients in ``movers.npz``, which `tools.training.train_movers` fits to rendered scenes, name the command.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blur2view.smears.field import upsample_grid

DILATIONS = {"around1": 1, "around2": 2, "around4": 4}  # distance of the half cells that a layer looks at
GUESSED = 4.0  # times the guessed smear's probabilities, which are small
COEFFICIENTS = Path(__file__).with_name("movers.npz")

Floats = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class Decoder:
    """The coefficients.

    Parameters
    ----------
    mean_halves, scale_halves, mean_quarters, scale_quarters : ndarray of shape (K,)
        Of the evidence over the training scenes.
    weights : mapping of str to ndarray of shape (C_out, C_in, k, k)
        Of the layers by name, k = 1 or 3.
    biases : mapping of str to ndarray of shape (C_out,)
    """

    mean_halves: Floats
    scale_halves: Floats
    mean_quarters: Floats
    scale_quarters: Floats
    weights: Mapping[str, Floats]
    biases: Mapping[str, Floats]

    @classmethod
    def read(cls, path: Path = COEFFICIENTS) -> Decoder:
        """Return the coefficients of a file."""
        with np.load(path) as stored:
            names = [name.removeprefix("weight_") for name in stored if name.startswith("weight_")]
            return cls(
                mean_halves=stored["mean_halves"],
                scale_halves=stored["scale_halves"],
                mean_quarters=stored["mean_quarters"],
                scale_quarters=stored["scale_quarters"],
                weights={name: stored[f"weight_{name}"].astype(np.float32) for name in names},
                biases={name: stored[f"bias_{name}"] for name in names},
            )

    def log_odds(self, halves: Floats, quarters: Floats) -> tuple[Floats, Floats]:
        """Return log-odds (2h, 2w) that quarters move, and that smears are read right there.

        Of the evidence of half cells, (h, w, K), and of quarters, (2h, 2w, L).
        """
        halves = (halves - self.mean_halves) / self.scale_halves
        quarters = (quarters - self.mean_quarters) / self.scale_quarters
        cells = _positive(self._layer("halves", halves))
        cells = cells + _positive(self._layer("beside", cells))
        fine = _positive(self._layer("quarters", quarters) + upsample_grid(self._layer("down", cells), 2))
        for name in ("fine1", "fine2"):
            fine = fine + _positive(self._layer(name, fine))
        smear = GUESSED * _shares(self._layer("smear", fine))
        joined = np.concatenate([cells, _halved(fine), _halved(smear)], axis=-1)
        wide = _positive(self._layer("evidence", halves) + self._layer("joined", joined))
        for name, dilation in DILATIONS.items():
            wide = _positive(self._layer(name, wide, dilation))
        last = _positive(fine + upsample_grid(self._layer("back", wide), 2))
        found = self._layer("outline", _positive(self._layer("last", last)))
        found = found + upsample_grid(self._layer("moves", wide), 2)
        return found[..., 0], found[..., 1]

    def _layer(self, name: str, x: Floats, dilation: int = 1) -> Floats:
        """Return (h, w, C_out) of (h, w, C_in); what the border holds repeats."""
        weight, height, width = self.weights[name], *x.shape[:2]
        size = weight.shape[-1]
        margin = dilation * (size // 2)
        padded = np.pad(x, ((margin, margin), (margin, margin), (0, 0)), mode="edge")
        total = np.zeros((height, width, len(weight)), np.float32)
        for row, column in np.ndindex(size, size):
            top, left = dilation * row, dilation * column
            total += padded[top : top + height, left : left + width] @ weight[:, :, row, column].T
        return total + self.biases[name]


def _positive(x: Floats) -> Floats:
    return np.maximum(x, 0)


def _shares(x: Floats) -> Floats:
    """Return exponentials that sum to 1 over the last axis."""
    positive = np.exp(x - x.max(axis=-1, keepdims=True))
    return np.asarray(positive / positive.sum(axis=-1, keepdims=True), np.float32)


def _halved(x: Floats) -> Floats:
    """Return means (h, w, C) of squares of four of (2h, 2w, C)."""
    return np.asarray(sum(x[i::2, j::2] for i in (0, 1) for j in (0, 1)) / 4, np.float32)


@cache
def shipped() -> Decoder:
    """Return the coefficients that ship."""
    return Decoder.read()
