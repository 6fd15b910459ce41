"""What is read of a picture before anything is learned: polar cepstra of its windows (torch).

A straight, even smear d multiplies a picture's spectrum by sinc(f . d); the log power spectrum then holds a
comb, whose inverse transform, the cepstrum, has a negative peak at +d and -d whatever the texture. Every
window's cepstrum is sampled on a polar grid of directions and log lengths: a turn of the picture is a
circular shift of the grid, a change of scale a shift along the lengths.
"""

from __future__ import annotations

import functools
import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as nnf

from blur2view.networks.comb import NOISE_FLOOR, STEP, TAPER, TREND, WINDOW
from blur2view.smears.likelihood import DIRECTIONS, SHORTEST_PX

LAGS = 18
"""Lengths read in one octave: 2 to 38 px, four an octave; beyond 0.4 of the window a lag cannot be read."""
COMB_LAGS_PX = np.concatenate([SHORTEST_PX * 2 ** (np.arange(8) / 4), 8 * 2 ** (np.arange(19) / 8)])
"""Lags of the comb's cepstrum: eight an octave from 8 px on, where peaks are narrower."""
TREND_LAGS_PX = SHORTEST_PX / 2 * 2 ** (np.arange(18) / 4)
"""Lags at which the cepstrum that keeps the spectrum's trend is sampled: 1 to 19 px."""
SPLIT = len(COMB_LAGS_PX) * DIRECTIONS
SAMPLES = len(COMB_LAGS_PX) + len(TREND_LAGS_PX)
RELATIVE_FLOOR = 1e-3
"""NOISE_FLOOR as a share of the window's mean power, for the second of two cepstra."""
FREQUENCIES = 40
"""Frequencies that are kept along each axis, in bins of 1 / 96 px."""
SCALARS = 5


def frequency_grid() -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows (-40 ... 40) and columns (0 ... 40) of the kept half plane of frequencies."""
    return np.arange(-FREQUENCIES, FREQUENCIES + 1), np.arange(FREQUENCIES + 1)


def polar_map(lags_px: NDArray[np.float64], taper_width: float, trend: bool) -> NDArray[np.float32]:
    """Return the matrix (81 * 41, 32 * lags) from half a log power spectrum to the cepstrum's polar samples.

    Columns: the inverse transform at a polar bin (Gaussian footprint 0.6 px + 4 % of the lag) of the spectrum
    tapered towards high frequencies. To subtract the spectrum's trend is, in the cepstrum, a factor that
    vanishes at no lag.
    """
    rows, columns = frequency_grid()
    fy, fx = np.meshgrid(rows, columns, indexing="ij")
    radius = np.hypot(fx, fy)
    taper = np.exp(-((radius / (WINDOW * taper_width)) ** 2)) * (1 - np.exp(-((radius / 3) ** 2)))
    taper *= (radius <= FREQUENCIES) & ~((abs(fx) <= 1) & (abs(fy) <= 1))  # the window's own mean
    taper *= np.where(fx == 0, 1.0, 2.0) / WINDOW**2  # the other half plane is the same
    place = np.arange(-WINDOW // 2, WINDOW // 2)
    x, y = np.meshgrid(place, place)
    factor = 1 - np.exp(-2 * (math.pi * TREND / WINDOW) ** 2 * (x * x + y * y)) if trend else np.ones(x.shape)
    wave_y, wave_x = (np.exp(2j * np.pi * np.outer(f, place) / WINDOW) for f in (rows, columns))
    result = np.empty((len(rows) * len(columns), DIRECTIONS, len(lags_px)), np.float32)
    for k in range(DIRECTIONS):
        cosine, sine = math.cos(math.pi * k / DIRECTIONS), math.sin(math.pi * k / DIRECTIONS)
        for j, lag in enumerate(lags_px):
            apart = (x - lag * cosine) ** 2 + (y - lag * sine) ** 2
            footprint = np.exp(-apart / (2 * (0.6 + 0.04 * lag) ** 2))
            footprint = footprint / footprint.sum() * factor
            result[:, k, j] = ((wave_y @ footprint @ wave_x.T).real * taper).ravel()
    return result.reshape(len(rows) * len(columns), -1)


@functools.cache  # seconds of work
def polar_maps() -> NDArray[np.float32]:
    """Return both maps side by side, (81 * 41, 32 * 45), rounded to float16 as the exported file stores them.

    The first shows combs of 2 to 38 px without the spectrum's trend; the second, of 1 to 19 px, keeps the
    trend and more of the high frequencies.
    """
    maps = polar_map(COMB_LAGS_PX, TAPER, True), polar_map(TREND_LAGS_PX, 0.4, False)
    return np.hstack(maps).astype(np.float16).astype(np.float32)


def power_bins() -> Tensor:
    """Return the indices, of 81 * 41, of the frequencies that measure a window's mean power: 4 to 40 bins."""
    rows, columns = frequency_grid()
    radius = np.hypot(*np.meshgrid(columns, rows))
    return torch.from_numpy(np.flatnonzero(((radius >= 4) & (radius <= FREQUENCIES)).ravel()))


class Spectra(nn.Module):
    """Grey picture (N, 1, H, W), sRGB-coded, H and W multiples of 32 -> features of its windows.

    Samples of two polar cepstra (N, h, w, 32, 45), each of mean 0 and deviation 1, and scalars (N, h, w, 5):
    logs of both deviations and of the mean power, shares of white and of black. This one uses the FFT;
    :class:`SpectraByProducts` is its twin for export.
    """

    map: Tensor
    window: Tensor
    bins: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("map", torch.from_numpy(polar_maps()), persistent=False)
        self.register_buffer("bins", power_bins(), persistent=False)
        hann = torch.hann_window(WINDOW, periodic=False)
        self.register_buffer("window", hann[:, None] * hann[None], persistent=False)

    @torch.no_grad()
    def forward(self, grey: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the features."""
        padded = padded_picture(grey)
        u = padded.unfold(2, WINDOW, STEP).unfold(3, WINDOW, STEP)[:, 0]
        n, h, w = u.shape[:3]
        power = torch.fft.rfft2(u * self.window).abs().square()
        kept = torch.cat([power[..., -FREQUENCIES:, :], power[..., : FREQUENCIES + 1, :]], -2)
        power = kept[..., : FREQUENCIES + 1].reshape(n * h * w, -1)
        mean = power[:, self.bins].mean(1, keepdim=True)
        return features_of(power, mean, self.map, padded, (n, h, w))


class SpectraByProducts(nn.Module):
    """The same features of one picture by products, at which ONNX Runtime is fast; equal to rounding."""

    across: Tensor
    down: Tensor
    map: Tensor
    mean: Tensor
    kept: Tensor

    def __init__(self) -> None:
        super().__init__()
        rows, columns = frequency_grid()
        hann, place = np.hanning(WINDOW), np.arange(WINDOW)
        wave = hann * np.exp(-2j * np.pi * np.outer(columns, place) / WINDOW)  # (41, 96), along x
        across = np.stack([wave.real, wave.imag], 1).reshape(-1, 1, 1, WINDOW)
        wave = hann * np.exp(-2j * np.pi * np.outer(rows, place) / WINDOW)  # (81, 96), along y
        real, imaginary = np.stack([wave.real, -wave.imag], 1), np.stack([wave.imag, wave.real], 1)
        down = np.concatenate([real, imaginary])[..., None]  # (162, 2, 96, 1)
        keep = np.zeros(len(rows) * len(columns))
        keep[power_bins().numpy()] = 1 / len(power_bins())
        size = (len(rows), len(columns))
        maps = polar_maps().reshape(*size, -1).transpose(1, 0, 2).reshape(size[0] * size[1], -1)
        kept = np.flatnonzero(abs(maps).max(1))  # three quarters: a half disc of frequencies
        self.register_buffer("kept", torch.from_numpy(kept), persistent=False)
        self.register_buffer("across", torch.from_numpy(across.astype(np.float32)), persistent=False)
        self.register_buffer("down", torch.from_numpy(down.astype(np.float32)), persistent=False)
        self.register_buffer("map", torch.from_numpy(maps[kept].astype(np.float16)), persistent=False)
        mean = np.ascontiguousarray(keep.reshape(size).T.reshape(1, -1)[:, kept], np.float32)
        self.register_buffer("mean", torch.from_numpy(mean), persistent=False)

    def forward(self, grey: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the features; rows of a window are transformed once for all windows that share them."""
        padded = padded_picture(grey)
        x = nnf.conv2d(padded, self.across, stride=(1, STEP))[0]  # (41 * 2, H + 64, w)
        x = x.reshape(FREQUENCIES + 1, 2, -1, x.shape[-1])
        y = nnf.conv2d(x, self.down, stride=(STEP, 1))  # (41, 2 * 81, h, w)
        h, w = y.shape[2:]
        power = (y * y).reshape(FREQUENCIES + 1, 2, -1, h * w).sum(1).reshape(-1, h * w)
        power = torch.index_select(power, 0, self.kept)
        return features_of(power.T, (self.mean @ power).T, self.map.float(), padded, (1, h, w))


def padded_picture(grey: Tensor) -> Tensor:
    """Return a picture (N, 1, H, W), less one half, with a mirrored border: windows are centred on cells."""
    return nnf.pad(grey - 0.5, ((WINDOW - STEP) // 2,) * 4, mode="reflect")


def features_of(
    power: Tensor, mean: Tensor, maps: Tensor, padded: Tensor, shape: tuple[int, int, int]
) -> tuple[Tensor, Tensor]:
    """Return cepstra and scalars of power spectra (N h w, F), their means (N h w, 1), the padded picture."""
    n, h, w = shape
    cepstra, scalars = [], []
    floors: tuple[float | Tensor, ...] = (NOISE_FLOOR, RELATIVE_FLOOR * mean + 1e-4)
    for floor, polar in zip(floors, (maps[:, :SPLIT], maps[:, SPLIT:]), strict=True):
        C = torch.log(power + floor) @ polar
        C = C - C.mean(1, keepdim=True)
        deviation = torch.sqrt((C * C).sum(1, keepdim=True) / (polar.shape[1] - 1))
        cepstra.append((C / (deviation + 1e-3)).reshape(n, h, w, DIRECTIONS, -1))
        scalars.append(torch.log(deviation + 1e-3) + 3)
    ends = torch.cat([(padded > 0.49).to(padded.dtype), (padded < -0.49).to(padded.dtype)], 1)
    clipped = nnf.avg_pool2d(nnf.avg_pool2d(ends, STEP), WINDOW // STEP, stride=1)
    scalars += [torch.log(mean + 1e-3) / 3, 2 * clipped.permute(0, 2, 3, 1).reshape(n * h * w, 2)]
    return torch.cat(cepstra, 4), torch.cat(scalars, 1).reshape(n, h, w, SCALARS)


def halved(grey: Tensor) -> Tensor:
    """Average 2 x 2 pixels of (N, 1, H, W)."""
    return nnf.avg_pool2d(grey, 2)
