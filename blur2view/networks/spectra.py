"""Polar cepstra of a picture's windows, the input of the smear network.

A straight, even smear d multiplies a picture's spectrum by sinc(f . d): the cepstrum, the inverse transform
of the log power spectrum, has a negative peak at d and -d whatever the texture. It is sampled on a polar
grid of directions and log lengths, which rotation and scale of the picture shift. The samples are linear in
the log spectrum, whose four symmetric parts on an eighth of the plane are multiplied by the samples of
directions 0 to 45 degrees alone: a quarter of the products.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array, Floats
from blur2view.networks.model_file import once
from blur2view.smears.likelihood import DIRECTIONS, SHORTEST_PX

Integers = NDArray[np.intp]

WINDOW, STEP = 96, 32  # side of a Hann window and the distance of windows, pixels
NOISE_FLOOR = 0.02  # power of half a grey level of noise: a frequency below it holds no signal
RELATIVE_FLOOR = 1e-3  # the floor of the second cepstrum, as a share of the window's mean power
TREND = 8.0  # bins of frequency: width of the Gaussian that separates a spectrum's trend from its zeros
TAPERS = 0.28, 0.4  # of the window's side: both cepstra are tapered towards high frequencies, noise
HANN = np.outer(np.hanning(WINDOW), np.hanning(WINDOW)).astype(np.float32)
FREQUENCIES = 40  # frequencies that are kept along each axis, in bins of 1 / 96 px
# Lags of both cepstra: 2 to 38 px, eight an octave where peaks are narrow, and 1 to 19 px with the trend.
PEAK_LAGS_PX = np.concatenate([SHORTEST_PX * 2 ** (np.arange(8) / 4), 8 * 2 ** (np.arange(19) / 8)])
TREND_LAGS_PX = SHORTEST_PX / 2 * 2 ** (np.arange(18) / 4)
MIN_FREQUENCY = 4  # bins: the mean power beside the cepstra is of this frequency and higher ones
EIGHTH = DIRECTIONS // 4  # directions in 45 degrees
LAGS = len(PEAK_LAGS_PX) + len(TREND_LAGS_PX)
SCALES = 3  # numbers beside the cepstra of a window: logs of both deviations and of the mean power
BATCH = 16  # windows transformed at a time: a core's cache holds them, results do not depend on threads
# Windows, of a look, up to which one thread is as fast: of 96 two take 1.2 times the processor time, or more.
FEW = 100
CEPSTRA_BATCH = 120  # spectra whose cepstra are sampled at a time; matrices of 40 take 1.25 times as long


def in_batches(work: Callable[[slice], None], count: int, threads: int, batch: int) -> None:
    """Call ``work`` with slices of ``batch`` of ``count`` items, in any order, on some threads."""
    parts = [slice(first, first + batch) for first in range(0, count, batch)]
    if threads == 1 or len(parts) == 1:
        for part in parts:
            work(part)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, parts))


def sliding_windows(grey: Floats, apart: int = STEP) -> Floats:
    """Return a view: windows (h, w, 96, 96) of a picture (apart h, apart w), mirrored beyond its border."""
    border, first = max((WINDOW - apart) // 2, 0), max((apart - WINDOW) // 2, 0)
    padded = np.pad(grey, border, mode="reflect") if border else grey
    windows: Floats = np.lib.stride_tricks.sliding_window_view(padded, (WINDOW, WINDOW))
    return windows[first::apart, first::apart]


def power_spectra(windows: Floats, threads: int = 1) -> Floats:
    """Return the power spectra (h, w, 96, 49), in order of an rfft2, of windows (h, w, 96, 96) of luma."""
    h, w = windows.shape[:2]
    rows, columns = np.divmod(np.arange(h * w), w)
    power = np.empty((h * w, WINDOW, WINDOW // 2 + 1), np.float32)

    def transform(part: slice) -> None:
        spectrum, half = power[part], WINDOW // 2
        own = windows[rows[part], columns[part]] - np.float32(0.5)
        own *= HANN
        for window in own:
            cv2.dft(window, window)  # faster than NumPy's; SciPy's is slow to import
        own *= own
        np.add(own[:, :, 1:-1:2], own[:, :, 2:-1:2], out=spectrum[:, :, 1:-1])
        for column in (0, -1):  # real ones, whose rows are packed in turn
            spectrum[:, 0, column], spectrum[:, half, column] = own[:, 0, column], own[:, -1, column]
            spectrum[:, 1:half, column] = own[:, 1:-1:2, column] + own[:, 2:-1:2, column]
            spectrum[:, half + 1 :, column] = spectrum[:, half - 1 : 0 : -1, column]

    in_batches(transform, h * w, threads if h * w > FEW else 1, BATCH)
    return power.reshape(h, w, *power.shape[1:])


def polar_cepstra(power: Floats, threads: int = 1) -> tuple[Floats, Floats]:
    """Return polar cepstra (h, w, 32, 45) of spectra, and logs of deviations and mean power (h, w, 3)."""
    h, w = power.shape[:2]
    spectra = power.reshape(h * w, -1)
    cepstra = np.empty((h * w, DIRECTIONS, LAGS), np.float32)
    scales = np.empty((h * w, SCALES), np.float32)
    index, mean_weights, sample_maps = polar_map()

    def transform(part: slice) -> None:
        eighths = spectra[part].take(index, 1, mode="clip")  # without checks: a third of the time
        mean = eighths @ mean_weights
        relative = np.float32(RELATIVE_FLOOR) * mean[:, None] + np.float32(1e-4)
        floors = np.full_like(relative, NOISE_FLOOR), relative
        both = np.split(cepstra[part], [len(PEAK_LAGS_PX)], axis=-1)
        for k, (floor, samples, cepstrum) in enumerate(zip(floors, sample_maps, both, strict=True)):
            values = sampled(np.log(eighths + floor), samples)
            values -= values.mean((1, 2), keepdims=True)
            square = np.einsum("nkl,nkl->n", values, values) / (values[0].size - 1)
            deviation = np.sqrt(square) + np.float32(1e-3)
            np.divide(values, deviation[:, None, None], out=cepstrum)
            scales[part, k] = np.log(deviation) + 3
        scales[part, 2] = np.log(mean + np.float32(1e-3)) / 3

    in_batches(transform, h * w, threads, CEPSTRA_BATCH)
    return cepstra.reshape(h, w, DIRECTIONS, LAGS), scales.reshape(h, w, SCALES)


def sampled(logs: Floats, samples: Floats) -> Floats:
    """Return polar samples (n, 32, lags) of log spectra on four eighths of the plane (n, 4 * f).

    The samples C of a direction t, 0 to 45 degrees, and of its reflections are sums of four parts, each of
    which is even or odd at the x axis (first letter) and at the diagonal (second letter):

        C(t)      = ee + oe + eo + oo,    C(90 - t)  = ee + oe - eo - oo,
        C(90 + t) = ee - oe - eo + oo,    C(180 - t) = ee - oe + eo - oo.

    A part is the product of ``samples`` (`polar_map`) and of the part of the log power L that has the same
    symmetry: with L_d = L(y, x), L_x = L(x, -y) and L_dx = L(y, -x), ee is of L + L_d + L_x + L_dx.
    """
    L, L_d, L_x, L_dx = np.moveaxis(logs.reshape(len(logs), 4, -1), 1, 0)
    even, odd, even_x, odd_x = L + L_d, L - L_d, L_x + L_dx, L_x - L_dx
    parts = even + even_x, even - even_x, odd + odd_x, odd - odd_x
    products = (part @ matrix for part, matrix in zip(parts, samples, strict=True))
    ee, oe, eo, oo = (product.reshape(len(logs), EIGHTH + 1, -1) for product in products)
    even, odd, even_d, odd_d = ee + eo, oe + oo, ee - eo, oe - oo  # at the x axis; _d: of 90 - t
    values = np.empty((len(logs), DIRECTIONS, ee.shape[-1]), np.float32)
    values[:, : EIGHTH + 1] = even + odd
    values[:, EIGHTH : 2 * EIGHTH + 1] = (even_d + odd_d)[:, ::-1]
    values[:, 2 * EIGHTH : 3 * EIGHTH + 1] = even_d - odd_d
    values[:, 3 * EIGHTH :] = (even - odd)[:, :0:-1]
    return values


@once
def polar_map() -> tuple[Integers, Floats, tuple[Floats, Floats]]:
    """Return the linear map from log spectra to polar samples, split by symmetry as in `sampled`.

    Indices (4 n,) in a flat spectrum (96, 49) of (x, y), (y, x), (x, -y) and (y, -x) for the n frequencies
    0 <= y <= x; weights (4 n,) of the mean power; and for both cepstra the matrices (4, n, 9 * lags) of the
    parts ee, oe, eo and oo, to directions of 0 to 45 degrees: with ``signs`` s (4, 4) of the parts, and M_k
    the matrix of the k-th of the four frequencies (`polar_samples`), sum_k s_k M_k / 4.
    """
    y, x = (i.ravel() for i in np.indices((FREQUENCIES + 1,) * 2))
    keep = (y <= x) & (x > 1) & (np.hypot(x, y) <= FREQUENCIES)
    x, y = x[keep], y[keep]
    columns, rows = np.stack([x, y, x, y]), np.stack([y, x, -y, -x])
    share = np.where(x == y, 0.5, 1) * np.ones((4, 1))  # what lies in two eighths counts half in each
    share[::2] *= np.where(y == 0, 0.5, 1)
    mean = share * (np.hypot(x, y) >= MIN_FREQUENCY)
    signs = np.array([[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]], np.float32) / 4
    weight = share[..., None].astype(np.float32)
    first, second = (
        np.einsum("sp,pfk->sfk", signs, polar_samples(cepstrum, columns, rows) * weight)
        for cepstrum in range(2)
    )
    index = rows % WINDOW * (WINDOW // 2 + 1) + columns
    return index.ravel(), (mean / mean.sum()).astype(np.float32).ravel(), (first, second)


def polar_samples(cepstrum: int, columns: Integers, rows: Integers) -> Floats:
    """Return the matrix (..., 9 * lags) from the log power of frequencies (...) to samples to 45 degrees.

    The inverse transform at polar bins (Gaussian footprint 0.6 px + 4 % of the lag) of the tapered spectrum.
    To subtract the spectrum's trend, as the first cepstrum (0) does, is a factor of the cepstrum that
    vanishes at no lag. Entries are rounded to float16, as the network saw them in training.
    """
    radius = np.hypot(rows, columns)
    taper = np.exp(-((radius / (WINDOW * TAPERS[cepstrum])) ** 2)) * (1 - np.exp(-((radius / 3) ** 2)))
    taper *= np.where(columns == 0, 1, 2) / WINDOW**2  # half a plane is the other half
    lags = (PEAK_LAGS_PX, TREND_LAGS_PX)[cepstrum]
    angles = np.pi / DIRECTIONS * np.arange(EIGHTH + 1)
    sigma = np.tile(0.6 + 0.04 * lags, len(angles))
    pixel = np.arange(-WINDOW // 2, WINDOW // 2)[:, None]
    middles = (np.outer(f(angles), lags).ravel() for f in (np.cos, np.sin))
    x, y = (np.exp(-((pixel - middle) ** 2) / (2 * sigma**2)) for middle in middles)
    wave = np.exp(2j * np.pi * np.outer(np.arange(-FREQUENCIES, FREQUENCIES + 1), pixel) / WINDOW)

    def transformed(x: Array, y: Array) -> Array:
        across, down = (wave @ x)[columns + FREQUENCIES], (wave @ y)[rows + FREQUENCIES]
        return np.asarray(across.real * down.real - across.imag * down.imag)

    result = transformed(x, y)
    if cepstrum == 0:
        trend = np.exp(-2 * (np.pi * TREND / WINDOW * pixel) ** 2)
        result -= transformed(x * trend, y * trend)
    result *= taper[..., None]
    result /= x.sum(0) * y.sum(0)
    step = np.ldexp(1.0, np.maximum(np.frexp(result)[1] - 11, -24))  # of float16, which NumPy converts slowly
    return np.asarray(np.rint(result / step) * step, np.float32)
