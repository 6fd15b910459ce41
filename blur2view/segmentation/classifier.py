"""A small network over half cells that weighs the evidence: that they move, and that smears are read.

Layers of 3x3 half cells, ever further apart, between two of single ones: about 7500 coefficients in
``movers.npz``, which `tools.training.train_movers` fits to rendered scenes; the file names the command.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from blur2view.arrays import AnyArray, Array

DILATIONS = (1, 1, 2, 4, 1)  # distance of the half cells that each layer looks at
COEFFICIENTS = Path(__file__).with_name("movers.npz")


@dataclass(frozen=True, kw_only=True, eq=False)
class Classifier:
    """The coefficients.

    Parameters
    ----------
    mean, scale : ndarray of shape (K,)
        Of the evidence over the training scenes.
    weights : tuple of ndarray of shape (C_out, C_in, k, k)
        Of the layers, k = 1 or 3; all but the last are followed by max(0, x).
    biases : tuple of ndarray of shape (C_out,)
    """

    mean: Array
    scale: Array
    weights: tuple[Array, ...]
    biases: tuple[Array, ...]

    @classmethod
    def read(cls, path: Path = COEFFICIENTS) -> Classifier:
        """Return the coefficients of a file."""
        with np.load(path) as stored:
            count = sum(name.startswith("weight") for name in stored)
            return cls(
                mean=stored["mean"],
                scale=stored["scale"],
                weights=tuple(stored[f"weight{k}"].astype(np.float32) for k in range(count)),
                biases=tuple(stored[f"bias{k}"] for k in range(count)),
            )

    def log_odds(self, evidence: Array) -> tuple[Array, Array]:
        """Return log-odds (h, w) that cells move, and that their smears are read right, of (h, w, K)."""
        x: AnyArray = ((evidence - self.mean) / self.scale).astype(np.float32)
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = _convolved(x if k == 0 else np.maximum(x, 0), weight, DILATIONS[k]) + bias
        moving, read = np.moveaxis(x.astype(float), -1, 0)
        return moving, read


def _convolved(x: AnyArray, weight: AnyArray, dilation: int) -> AnyArray:
    """Return (h, w, C_out) of (h, w, C_in) and weights (C_out, C_in, k, k); what the border holds repeats."""
    height, width = x.shape[:2]
    size = weight.shape[-1]
    margin = dilation * (size // 2)
    padded = np.pad(x, ((margin, margin), (margin, margin), (0, 0)), mode="edge")
    total = np.zeros((height, width, len(weight)), np.float32)
    for row in range(size):
        for column in range(size):
            top, left = dilation * row, dilation * column
            total += padded[top : top + height, left : left + width] @ weight[:, :, row, column].T
    return total


@cache
def shipped() -> Classifier:
    """Return the coefficients that ship."""
    return Classifier.read()
