"""Features of windows: those that training sees are the shipped ones; a smear's peak is at the smear."""

import numpy as np
import pytest
import torch

from blur2view.networks.spectra import (
    LAGS,
    PEAK_LAGS_PX,
    SCALES,
    STEP,
    polar_cepstra,
    power_spectra,
    windows_of,
)
from blur2view.smears.likelihood import DIRECTIONS
from tools.training.spectra import Spectra, halved


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


@pytest.mark.parametrize(("length", "k"), [(8, 0), (8, 5), (16, 12), (16, 16), (11.31, 24), (22.63, 30)])
def test_lowest_sample_is_at_the_smear(spectra: Spectra, length: float, k: int) -> None:
    cepstra, _ = spectra(smeared_noise(length, 180 * k / DIRECTIONS))
    lowest = cepstra[0, 1:-1, 1:-1, :, : len(PEAK_LAGS_PX)].mean((0, 1)).numpy()
    long = PEAK_LAGS_PX >= 4  # below, the trend and the pixel lattice are lower yet
    row, column = np.unravel_index(lowest[:, long].argmin(), lowest[:, long].shape)
    assert min((row - k) % DIRECTIONS, (k - row) % DIRECTIONS) == 0
    assert PEAK_LAGS_PX[long][column] == pytest.approx(length, rel=0.1)


def test_features_are_normalised_and_pictures_of_a_batch_do_not_mix(spectra: Spectra) -> None:
    grey = torch.full((1, 1, 3 * STEP, 5 * STEP), 0.5)
    grey[..., : 2 * STEP] = 1
    grey[..., 4 * STEP :] = 0
    noise = smeared_noise(8, 10, (3 * STEP, 5 * STEP))
    cepstra, scalars = spectra(torch.cat([grey, noise]))
    assert torch.isfinite(scalars).all()
    torch.testing.assert_close(scalars[0, 1, :, 3], torch.tensor([2, 4 / 3, 2 / 3, 0, 0]), atol=0.1, rtol=0)
    torch.testing.assert_close(scalars[0, 1, :3, 4], torch.zeros(3))
    assert scalars[0, 1, 3, 4] > 0.5 and scalars[0, 1, 4, 4] > 1
    for together, alone in zip((cepstra, scalars), spectra(noise), strict=True):
        torch.testing.assert_close(together[1:], alone, atol=1e-4, rtol=1e-4)
    for part in (cepstra[1, ..., : len(PEAK_LAGS_PX)], cepstra[1, ..., len(PEAK_LAGS_PX) :]):
        flat = part.flatten(-2)
        torch.testing.assert_close(flat.mean(-1), torch.zeros(3, 5), atol=1e-4, rtol=0)
        torch.testing.assert_close(flat.std(-1), torch.ones(3, 5), atol=0.1, rtol=0)
    quarters = halved(torch.arange(16.0).reshape(1, 1, 4, 4))[0, 0]
    torch.testing.assert_close(quarters, torch.tensor([[2.5, 4.5], [10.5, 12.5]]))
