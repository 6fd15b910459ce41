"""Kinds of blur, and radii out of focus, read off a network's logits for every cell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blur2view.smears.likelihood import PER_OCTAVE

Floats = NDArray[np.float32]

KINDS = ("sharp", "out of focus", "smeared", "out of focus and smeared", "cannot tell")
"""Kinds of blur that a cell may show, in the order of the network's logits."""
SHARP, OUT_OF_FOCUS, SMEARED, BOTH, CANNOT_TELL = range(len(KINDS))
SMALLEST_RADIUS_PX = 0.7
"""Radius of bin 1, of four an octave; before it stands one bin for anything smaller, last one for anything
larger. A radius is that of the disc which spreads as widely as lens and camera do."""
IN_FOCUS_PX = 0.5
"""Radius that stands for bin 0."""


def radii_px(bins: int) -> Floats:
    """Return the radii of the bins, (bins,), pixels."""
    radii = SMALLEST_RADIUS_PX * 2.0 ** ((np.arange(bins) - 1) / PER_OCTAVE)
    radii[0] = IN_FOCUS_PX
    return radii.astype(np.float32)


def softmax(logits: Floats) -> Floats:
    """Return probabilities of logits (..., n)."""
    values = np.exp(logits - logits.max(-1, keepdims=True))
    return np.asarray(values / values.sum(-1, keepdims=True), np.float32)


def read_radii(logits: Floats) -> Floats:
    """Return the radii out of focus (h, w), pixels, of logits (h, w, bins): means of their logarithms."""
    return np.asarray(np.exp(softmax(logits) @ np.log(radii_px(logits.shape[-1]))), np.float32)
