"""Features of windows: those that training sees are the shipped ones; a smear's peak is at the smear."""

import numpy as np
import pytest
import torch

from blur2view.networks.spectra import LAGS, SCALES, polar_cepstra, power_spectra, windows_of
from blur2view.smears.likelihood import DIRECTIONS
from tools.training.spectra import Spectra


@pytest.fixture(scope="module")
def spectra() -> Spectra:
    return Spectra()


def smeared_noise(length: float, angle_deg: float, size: tuple[int, int] = (192, 192)) -> torch.Tensor:
    """Return white noise (1, 1, H, W) that was smeared evenly: its spectrum times a sinc."""
    noise = np.random.default_rng(0).normal(0, 1, size)
    fy, fx = np.meshgrid(np.fft.fftfreq(size[0]), np.fft.fftfreq(size[1]), indexing="ij")
    angle = np.radians(angle_deg)
    blurred = np.fft.ifft2(
        np.fft.fft2(noise) * np.sinc(length * (fx * np.cos(angle) + fy * np.sin(angle)))
    ).real
    grey = 0.5 + 0.12 * blurred / blurred.std()
    return torch.from_numpy(np.clip(grey, 0, 1).astype(np.float32)[None, None])


def test_features_of_training_are_those_of_the_package(spectra: Spectra) -> None:
    rng = np.random.default_rng(1)
    grey = smeared_noise(9, 25, (256, 352))
    grey[..., :40, :60] = 1
    grey[..., 100:, 150:200] = torch.from_numpy(rng.random((156, 50), np.float32) * 0.2)
    cepstra, scalars = spectra(grey)
    for threads in (1, 2):
        actual, scales = polar_cepstra(power_spectra(windows_of(grey[0, 0].numpy()), threads), threads)
        assert actual.shape == (8, 11, DIRECTIONS, LAGS) and scales.shape == (8, 11, SCALES)
        np.testing.assert_allclose(actual, cepstra[0].numpy(), atol=1e-3)
        np.testing.assert_allclose(scales, scalars[0, ..., :SCALES].numpy(), atol=1e-4)
