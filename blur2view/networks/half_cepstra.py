"""Halves of the cepstra of a picture's windows, and their values between lags.

A cepstrum is even, so that the lags of y >= 0 are enough.
"""

from __future__ import annotations

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.networks.spectra import NOISE_FLOOR, TAPERS, TREND, WINDOW

Floats = NDArray[np.float32]

CEPSTRUM_RANGE_PX = 3.0, 40.0
"""Distances from the origin over which the deviation of a cepstrum is taken."""
MARGIN = 2
"""Rows before lag 0 that a cubic interpolation needs."""


def half_cepstra(power: Floats) -> Floats:
    """Return the halves (n, 50, 96) of the cepstra of power spectra (n, 96, 49), of mean 0 and deviation 1.

    Lags -2 to 47 along y and -48 to 47 along x: the inverse transform as two products of matrices.
    """
    taper, down, across, trendless, ring = filters()
    parts = down @ (np.log(power + np.float32(NOISE_FLOOR)) * taper)
    parts = parts.reshape(len(power), 2, len(trendless), -1).swapaxes(1, 2)  # sines beside their cosines
    flat = (parts.reshape(-1, len(across)) @ across).reshape(len(power), -1)
    flat *= trendless.ravel()
    mean, square = (flat @ ring)[:, None], ((flat * flat) @ ring)[:, None]
    flat -= mean
    flat /= np.sqrt(np.maximum(square - mean**2, 0)) + np.float32(1e-9)
    return np.asarray(flat.reshape(len(power), *trendless.shape))


@functools.cache
def filters() -> tuple[Floats, ...]:
    """Return what makes the half of a cepstrum of a log power spectrum.

    The spectrum's taper (96, 49); cosines, then sines, along y (2 * 50, 96) and along x (2 * 49, 96); factors
    by lag, 0 where a spectrum's trend is and 1 where peaks are (50, 96); and the weights of the mean over
    CEPSTRUM_RANGE_PX, (50 * 96,).
    """
    rows, columns = np.fft.fftfreq(WINDOW, 1 / WINDOW), np.arange(WINDOW // 2 + 1)
    x, y = np.arange(-WINDOW // 2, WINDOW // 2), np.arange(-MARGIN, WINDOW // 2)[:, None]
    radius, distance = np.hypot(rows[:, None], columns), np.hypot(y, x)
    taper = np.exp(-((radius / (TAPERS[0] * WINDOW)) ** 2)) * (1 - np.exp(-((radius / 3) ** 2)))
    taper *= np.where(columns % (WINDOW // 2), 2, 1) / WINDOW**2  # the other half plane is the same
    down, across = 2 * np.pi / WINDOW * y * rows, 2 * np.pi / WINDOW * columns[:, None] * x
    trendless = 1 - np.exp(-2 * (np.pi * TREND / WINDOW * distance) ** 2)
    ring = (distance >= CEPSTRUM_RANGE_PX[0]) & (distance <= CEPSTRUM_RANGE_PX[1])
    weights = (ring * np.heaviside(y, 0.5)).ravel()  # lags of y = 0 are there twice
    down, across = np.r_[np.cos(down), np.sin(down)], np.r_[np.cos(across), -np.sin(across)]
    arrays = taper, down, across, trendless, weights / weights.sum()
    return tuple(array.astype(np.float32) for array in arrays)


def values_at(cepstra: Floats, lags: NDArray[np.complex64]) -> Floats:
    """Return the values of halves of cepstra (n, 50, 96) at lags x + iy, (n, m), each its own; 0 outside."""
    lags = np.where(lags.imag < 0, -lags, lags)  # a cepstrum is even
    inside = lags.imag < WINDOW // 2 - 1  # or it would be read off the cepstrum below
    x = np.where(inside, lags.real + WINDOW // 2, -WINDOW)
    y = lags.imag + MARGIN + cepstra.shape[1] * np.arange(len(cepstra), dtype=np.float32)[:, None]
    values = cv2.remap(cepstra.reshape(-1, WINDOW), x, y, cv2.INTER_CUBIC)
    return np.asarray(values, np.float32)
