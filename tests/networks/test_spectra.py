"""The fixed part in NumPy; its cepstra are compared with torch's in tests/tools/training."""

import numpy as np
import pytest

from blur2view.networks.spectra import (
    FREQUENCIES,
    PEAK_LAGS_PX,
    TAPERS,
    TREND,
    TREND_LAGS_PX,
    WINDOW,
    polar_samples,
)
from blur2view.smears.likelihood import DIRECTIONS


@pytest.mark.parametrize("cepstrum", [0, 1])
def test_polar_samples_are_means_of_the_tapered_cepstrum_over_gaussians(cepstrum: int) -> None:
    rng, direction = np.random.default_rng(1), 5
    rows, columns = np.mgrid[-FREQUENCIES : FREQUENCIES + 1, : FREQUENCIES + 1]
    radius = np.hypot(rows, columns)
    kept = (radius <= FREQUENCIES) & ((columns > 1) | (abs(rows) > 1))
    half = rng.normal(size=radius.shape) * kept
    lags = (PEAK_LAGS_PX, TREND_LAGS_PX)[cepstrum]
    samples = half.ravel() @ polar_samples(cepstrum, columns.ravel(), rows.ravel())
    found = samples.reshape(-1, len(lags))[direction]
    taper = np.exp(-((radius / (WINDOW * TAPERS[cepstrum])) ** 2)) * (1 - np.exp(-((radius / 3) ** 2)))
    spectrum = np.zeros((WINDOW, WINDOW))
    spectrum[rows, columns] = half * taper
    spectrum[-rows, -columns] += (half * taper) * (columns > 0)
    place = np.arange(-WINDOW // 2, WINDOW // 2)
    values = np.fft.fftshift(np.fft.ifft2(spectrum).real)
    if cepstrum == 0:
        values *= 1 - np.exp(-2 * (np.pi * TREND / WINDOW) ** 2 * (place[:, None] ** 2 + place**2))
    angle = np.pi * direction / DIRECTIONS
    expected = []
    for lag in lags:
        apart = np.hypot(place[:, None] - lag * np.sin(angle), place - lag * np.cos(angle))
        weight = np.exp(-((apart / (0.6 + 0.04 * lag)) ** 2) / 2)
        expected.append((values * weight).sum() / weight.sum())
    np.testing.assert_allclose(found, expected, atol=2e-3 * np.std(expected))
