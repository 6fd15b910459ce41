"""Smears refined on the cepstral peak: between the network's bins, with the deviations that are left.

The network reads the negative peak of an even smear robustly, in bins of 5.6 degrees and 19 % of the length.
Here the cepstra of windows are sampled about its smears, turned and scaled in small steps, and summed over
neighbours, which share the error but not the texture. The smear is then the mean over
the network's own distribution times the likelihood of the peak (Bayes).
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Floats, Mask
from blur2view.networks.spectra import NOISE_FLOOR, TAPERS, TREND, WINDOW, in_batches
from blur2view.smears.likelihood import MIN_READ_SIGMA_PX, MIN_READ_SIGMA_RAD

MIN_PEAK_PX, MAX_PEAK_PX = 14.0, 28.0  # octave's pixels; longer smears are read in the next octave
UNSURE = 0.6  # deviation over length up to which the network's smear is taken for the peak's neighbourhood
# Rotations, radians, and log scales at which a cepstrum is sampled: half a pixel of the longest smear apart.
ROTATIONS = np.linspace(-0.3, 0.3, 33, dtype=np.float32)
LOG_SCALES = np.linspace(-0.35, 0.35, 25, dtype=np.float32)
# Weights of neighbouring windows along each axis (24 development scenes: with a normal of 0.5 or of 1 window
# rho of F is 1.06 and 1.11 times as large).
NEIGHBOUR_WEIGHTS = np.exp(-0.5 * (np.arange(-2, 3, dtype=np.float32) / 0.7) ** 2)
TEMPER = 0.5  # exponent of the peak's likelihood: neighbouring windows share two thirds of their pixels
CEPSTRUM_RANGE_PX = 3.0, 40.0  # distances from the origin over which the deviation of a cepstrum is taken
BATCH = 40  # windows at a time
PEAK_PX = 0.25  # standard deviation of the highest peaks about the truth (24 development scenes)

ERF = np.vectorize(math.erf, otypes=[np.float32])  # SciPy is slow to import


class Prior(NamedTuple):
    """The network's distribution of the smears of windows (h, w): means of their cells, octave's pixels."""

    smear: NDArray[np.complex64]  # x + iy, of either sign
    sigma_rad: Floats  # standard deviation of the direction
    sigma_log: Floats  # and of the logarithm of the length
    usable: Mask  # it is sure and long enough that its peak can be found


def refine_on_cepstrum(cells: Floats, spectra: list[Floats], threads: int = 1) -> Floats:
    """Move long and sure smears (h, w, 4), as `read_smears` returns them, to their cepstral peaks.

    ``spectra`` are the `power_spectra` (h, w, 96, 49) of the picture's octaves, the picture first. Their
    windows stand as far apart in the picture as the cells, or 2, 4, ... times as far.
    """
    length = np.hypot(cells[..., 0], cells[..., 1])
    octave = np.ceil(np.log2(np.maximum(length, 1) / MAX_PEAK_PX)).clip(0, len(spectra) - 1)
    refined = cells.copy()
    for k, power in enumerate(spectra):
        own, side = octave == k, len(cells) // len(power)
        prior = _prior(cells, length, own, side, 2**k)
        if prior.usable.any():
            corrections = _corrections(*_sampled_peaks(power, prior, threads), prior)
            own &= repeated(prior.usable, side) & (cells[..., 2] < UNSURE * length)
            refined[own] = _corrected(cells, repeated(corrections, side))[own]
    return refined


def repeated(cells: NDArray[Any], times: int) -> NDArray[Any]:
    """Repeat cells (h, w, ...) a number of times along both axes."""
    return np.repeat(np.repeat(cells, times, 0), times, 1)


def _prior(cells: Floats, length: Floats, own: Mask, side: int, scale: int) -> Prior:
    """Return the prior of an octave's windows of side x side cells; its pixels are ``scale`` times larger."""
    height, width = own.shape[0] // side, own.shape[1] // side
    values = np.concatenate([cells, length[..., None], np.ones_like(length)[..., None]], -1) * own[..., None]
    sums = values.reshape(height, side, width, side, 6).sum((1, 3))
    x, y, sigma_px, sigma_rad, mean = np.moveaxis(sums[..., :5] / np.maximum(sums[..., 5:], 1), -1, 0)
    long = (mean >= MIN_PEAK_PX * scale) & (mean <= 2 * MAX_PEAK_PX * scale)
    along = _along(mean, sigma_px, sigma_rad)
    return Prior(
        smear=(mean / scale * np.exp(0.5j * np.arctan2(y, x))).astype(np.complex64),
        sigma_rad=np.maximum(sigma_rad, MIN_READ_SIGMA_RAD),
        sigma_log=np.maximum(along / np.maximum(mean, 1e-3), MIN_READ_SIGMA_RAD),
        usable=long & (sigma_px < UNSURE * mean),
    )


def _sampled_peaks(power: Floats, prior: Prior, threads: int) -> tuple[Floats, Floats]:
    """Return the depths of cepstra about smears (h, w, 33, 25) and half smears (h, w, 221), in deviations."""
    usable = prior.usable
    full = np.exp(LOG_SCALES + 1j * ROTATIONS[:, None])
    steps = np.concatenate([full.ravel(), 0.5 * full[::2, ::2].ravel()]).astype(np.complex64)
    peaks = np.zeros((*usable.shape, len(steps)), np.float32)
    rows, columns = np.nonzero(usable)

    def sample(part: slice) -> None:
        cells = rows[part], columns[part]
        peaks[cells] = -_values_at(_cepstra(power[cells]), prior.smear[cells][:, None] * steps)

    in_batches(sample, len(rows), threads, BATCH)
    noise = np.sqrt(_over_neighbours(usable.astype(np.float32), NEIGHBOUR_WEIGHTS**2))
    summed = _over_neighbours(peaks, NEIGHBOUR_WEIGHTS)
    summed /= np.maximum(noise, 1e-3)[..., None]
    return summed[..., : full.size].reshape(*usable.shape, *full.shape), summed[..., full.size :]


def _corrections(peaks: Floats, halves: Floats, prior: Prior) -> Floats:
    """Return the corrections (h, w, 5) of smears, given the sampled peaks of their windows.

    Rotation r, radians; logarithm s of the factor of length; both posterior variances; the probability that
    the peak is the smear's. The posterior on the grid of samples is

        p(r, s) = N(r; 0, sigma_rad) N(s; 0, sigma_log) exp(e(v(r, s))) / Z,

    v the depth of the cepstrum there, in deviations, and e(v) = v^2 / 2, tempered, the evidence for a peak of
    unknown height (`_evidence`). Of the network's distribution, which is taken for normal, P =
    erf(r_max / (sigma_rad sqrt 2)) erf(s_max / (sigma_log sqrt 2)) lies inside the grid. What is outside has
    the evidence for half the smear, since a smear has a second, shallower peak at twice its length, so that
    the peak is the smear's with probability Z / (Z + (1 - P) exp(max e(half))).
    """
    r, s = ROTATIONS / prior.sigma_rad[..., None], LOG_SCALES / prior.sigma_log[..., None]  # in deviations
    density = np.exp(-0.5 * r**2)[..., :, None] * np.exp(-0.5 * s**2)[..., None, :]
    P = ERF(r[..., -1] / 2**0.5) * ERF(s[..., -1] / 2**0.5)
    density *= (P / density.sum((-2, -1)))[..., None, None]
    log_posterior = np.log(density + 1e-30) + _evidence(peaks)
    most = log_posterior.max((-2, -1))  # by whose exponential all that follows is divided
    posterior = np.exp(log_posterior - most[..., None, None])
    Z = posterior.sum((-2, -1))
    outside = (1 - P) * np.exp((_evidence(halves).max(-1) - most).clip(None, 80))
    least = ((PEAK_PX / np.maximum(np.hypot(prior.smear.real, prior.smear.imag), 1)) ** 2).astype(np.float32)
    corrections = []
    for axis, values in ((-1, ROTATIONS), (-2, LOG_SCALES)):
        weights = posterior.sum(axis) / Z[..., None]
        mean = weights @ values
        corrections.append((mean, np.maximum(weights @ values**2 - mean**2, 0) + least))
    (rotation, variance_rad), (log_scale, variance_log) = corrections
    return np.stack([rotation, log_scale, variance_rad, variance_log, Z / (Z + outside)], -1)


def _evidence(peaks: Floats) -> Floats:
    """Return the tempered log likelihood ratio of peaks against noise; 0 where the cepstrum rises."""
    return np.asarray(0.5 * TEMPER * np.maximum(peaks, 0) ** 2, np.float32)


def _corrected(cells: Floats, corrections: Floats) -> Floats:
    """Return cells (..., 4) turned and scaled, with the posterior deviations."""
    rotation, log_scale, variance_rad, variance_log, trust = np.moveaxis(corrections, -1, 0)
    x, y, sigma_px, sigma_rad = np.moveaxis(cells, -1, 0)
    length = np.hypot(x, y)
    along = _along(length, sigma_px, sigma_rad) / np.maximum(length, 1e-3)
    variance_rad = trust * variance_rad + (1 - trust) * sigma_rad**2
    variance_log = trust * variance_log + (1 - trust) * along**2
    length = length * np.exp(log_scale)
    double = np.arctan2(y, x) + 2 * rotation
    sigma_px = np.maximum(length * np.sqrt(variance_rad + variance_log), MIN_READ_SIGMA_PX)
    sigma_rad = np.maximum(np.sqrt(variance_rad), MIN_READ_SIGMA_RAD)
    return np.stack([length * np.cos(double), length * np.sin(double), sigma_px, sigma_rad], -1)


def _along(length: Floats, sigma_px: Floats, sigma_rad: Floats) -> Floats:
    """Return deviations along smears, pixels: the whole error less that across, at least 0.3 of it."""
    along: Floats = np.sqrt(np.maximum(sigma_px**2 - (length * sigma_rad) ** 2, (0.3 * sigma_px) ** 2))
    return along


def _over_neighbours(values: Floats, weights: Floats) -> Floats:
    """Return the weighted sums of values (h, w, ...) over neighbouring windows along both axes."""
    height, width = values.shape[:2]
    reach = len(weights) // 2
    rows, columns = (
        np.asarray(sum(w * np.eye(n, k=k - reach) for k, w in enumerate(weights)), np.float32)
        for n in (height, width)
    )
    down = (rows @ values.reshape(height, -1)).reshape(height, width, -1)
    return np.asarray((columns @ down).reshape(values.shape))


def _cepstra(power: Floats) -> Floats:
    """Return cepstra (n, 96, 96) at lags -48 to 47, of mean 0 and deviation 1, of power spectra."""
    taper, trendless, ring = _filters()
    cepstra = np.fft.irfft2(np.log(power + np.float32(NOISE_FLOOR)) * taper, (WINDOW, WINDOW))
    cepstra = np.asarray(np.fft.fftshift(cepstra, (1, 2)) * trendless, np.float32)
    ring_values = cepstra[:, ring]
    cepstra -= ring_values.mean(1)[:, None, None]
    return np.asarray(cepstra / (ring_values.std(1)[:, None, None] + np.float32(1e-9)))


@functools.cache
def _filters() -> tuple[Floats, Floats, Mask]:
    """Return the taper of spectra (96, 49), factors by lag (96, 96) that remove trends, peaks' lags."""
    rows, columns = np.fft.fftfreq(WINDOW, 1 / WINDOW)[:, None], np.arange(WINDOW // 2 + 1)
    radius, lags = np.hypot(rows, columns), np.arange(-WINDOW // 2, WINDOW // 2)
    distance = np.hypot(lags, lags[:, None])
    taper = np.exp(-((radius / (TAPERS[0] * WINDOW)) ** 2)) * (1 - np.exp(-((radius / 3) ** 2)))
    trendless = 1 - np.exp(-2 * (np.pi * TREND / WINDOW * distance) ** 2)
    ring = (distance >= CEPSTRUM_RANGE_PX[0]) & (distance <= CEPSTRUM_RANGE_PX[1])
    return taper.astype(np.float32), trendless.astype(np.float32), ring


def _values_at(cepstra: Floats, lags: NDArray[np.complex64]) -> Floats:
    """Return the values (n, m) of cepstra (n, 96, 96) at lags x + iy (n, m), pixels; 0 outside."""
    x, y = lags.real + WINDOW // 2, lags.imag + WINDOW // 2
    x[np.abs(lags.imag) >= WINDOW // 2 - 1] = -WINDOW  # or it would be read off the next cepstrum
    y += WINDOW * np.arange(len(cepstra), dtype=np.float32)[:, None]
    return np.asarray(cv2.remap(cepstra.reshape(-1, WINDOW), x, y, cv2.INTER_CUBIC), np.float32)
