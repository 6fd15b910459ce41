"""The polar cepstra of :mod:`blur2view.networks.spectra` for batches of pictures (torch).

The twin that training uses; it multiplies whole log spectra by the whole map, and is tested equal.
"""

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from blur2view.networks.spectra import (
    FREQUENCIES,
    LEAST_FREQUENCY,
    NOISE_FLOOR,
    PEAK_LAGS_PX,
    RELATIVE_FLOOR,
    SCALES,
    STEP,
    WINDOW,
    polar_samples,
)
from blur2view.smears.likelihood import DIRECTIONS

SPLIT = len(PEAK_LAGS_PX) * DIRECTIONS
SCALARS = SCALES + 2


def power_bins() -> Tensor:
    """Return the indices, of 81 * 41, of the frequencies that measure a window's mean power."""
    rows, columns = np.arange(-FREQUENCIES, FREQUENCIES + 1), np.arange(FREQUENCIES + 1)
    radius = np.hypot(rows[:, None], columns).ravel()
    return torch.from_numpy(np.flatnonzero((radius >= LEAST_FREQUENCY) & (radius <= FREQUENCIES)))


class Spectra(nn.Module):
    """Grey picture (N, 1, H, W), sRGB-coded, H and W multiples of 32 -> features of its windows.

    Samples of two polar cepstra (N, h, w, 32, 45), each of mean 0 and deviation 1, and scalars (N, h, w, 5):
    logs of both deviations and of the mean power, shares of white and of black.
    """

    map: Tensor
    window: Tensor
    bins: Tensor

    def __init__(self) -> None:
        super().__init__()
        maps = np.hstack([polar_samples(0), polar_samples(1)])  # of both cepstra, (81 * 41, 32 * 45)
        self.register_buffer("map", torch.from_numpy(maps), persistent=False)
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
    scalars += [torch.log(mean + 1e-3) / 3, clipped_shares(padded).reshape(n * h * w, 2)]
    return torch.cat(cepstra, 4), torch.cat(scalars, 1).reshape(n, h, w, SCALARS)


def clipped_shares(padded: Tensor) -> Tensor:
    """Return twice the shares of white and of black, (N, h, w, 2), of a padded picture's windows."""
    ends = torch.cat([(padded > 0.49).to(padded.dtype), (padded < -0.49).to(padded.dtype)], 1)
    clipped = nnf.avg_pool2d(nnf.avg_pool2d(ends, STEP), WINDOW // STEP, stride=1)
    return 2 * clipped.permute(0, 2, 3, 1)


def halved(grey: Tensor) -> Tensor:
    """Average 2 x 2 pixels of (N, 1, H, W)."""
    return nnf.avg_pool2d(grey, 2)
