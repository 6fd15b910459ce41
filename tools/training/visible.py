"""Which cells of a picture show their blur at all, given the noise of its camera: the others cannot tell."""

import cv2
import numpy as np

from blur2view.arrays import AnyArray as Array
from blur2view.networks.spectra import STEP

NARROW_PX, WIDE_PX = 0.75, 1.5
"""Deviations of the two Gaussians whose difference is the band of a blur of `EXTENT_PX`."""
EXTENT_PX = 2.0
REGION_PX = 20.0
"""Deviation of the region about a cell's centre, as that of a Hann window of 96 px."""
SIGNAL = 2.0
"""Power of a band over that of the noise there from which on it shows something."""
LEAST = 0.4 / 255
"""Amplitude of a band below which it shows nothing, whatever the noise."""


def shows_blur(grey: Array, noise: Array, extent_px: Array) -> Array:
    """Return whether cells (h, w) of a picture show their blur.

    Parameters
    ----------
    grey, noise : ndarray of shape (32 h, 32 w), float32
        Luma, and that of the same camera's picture of what has no detail.
    extent_px : ndarray of shape (h, w)
        The length of the smear or the diameter of the disc, pixels.

    Returns
    -------
    ndarray of bool
        Where the band of frequencies that this blur leaves holds more than noise.
    """
    levels = 1 + int(np.log2(max(min(grey.shape) / (2 * STEP), 1)))
    wanted = np.log2(np.maximum(extent_px, EXTENT_PX) / EXTENT_PX)
    level = np.minimum(np.round(wanted).astype(int), levels - 1)
    shows = np.zeros(extent_px.shape, bool)
    x, y = np.meshgrid(*(STEP * np.arange(n, dtype=np.float32) + STEP / 2 for n in extent_px.shape[::-1]))
    for k in range(levels):
        place = x / 2**k - 0.5, y / 2**k - 0.5
        region_px, powers = max(REGION_PX / 2**k, 4 * WIDE_PX), []
        for each in (grey, noise):
            narrow, wide = (cv2.GaussianBlur(each, (0, 0), sigma) for sigma in (NARROW_PX, WIDE_PX))
            band = cv2.GaussianBlur(np.asarray((narrow - wide) ** 2), (0, 0), region_px)
            powers.append(cv2.remap(band, *place, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
        power, quiet = powers
        clear = power > SIGNAL * quiet + LEAST**2
        shows[level == k] = clear[level == k]
        grey, noise = (
            cv2.resize(each, (each.shape[1] // 2, each.shape[0] // 2), interpolation=cv2.INTER_AREA)
            for each in (grey, noise)
        )
    return shows
