"""How sharp a photograph is, by the length of its smears."""

from __future__ import annotations


def sharpness(smear_px: float) -> float:
    """Return 1 / (1 + smear length in pixels): 1 without any, 0.5 at one pixel, always above 0."""
    return 1 / (1 + smear_px)
