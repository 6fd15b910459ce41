"""The camera between radiance and photograph."""

import numpy as np
import pytest

from tools.rendering import sensor
from tools.rendering.sensor import SensorOptions, add_noise, demosaic, expose, photograph, soften, tone


@pytest.fixture(scope="module")
def radiance() -> np.ndarray:
    rng = np.random.default_rng(0)
    blocks = rng.uniform(0, 1.5, (8, 10, 3)).repeat(8, 0).repeat(8, 1)
    return blocks.astype(np.float32)


def test_photograph_is_eight_bit_and_follows_from_its_seed(radiance: np.ndarray) -> None:
    before = radiance.copy()
    for seed in range(12):
        first, again = (photograph(np.random.default_rng(seed), radiance) for _ in range(2))
        assert first.dtype == np.uint8 and first.shape == radiance.shape
        assert first.tobytes() == again.tobytes()
        assert first.tobytes() != photograph(np.random.default_rng(seed + 100), radiance).tobytes()
        # brighter blocks stay brighter, whatever the camera does
        assert np.corrcoef(first.mean(2).ravel(), np.minimum(radiance, 1).mean(2).ravel())[0, 1] > 0.6
    np.testing.assert_array_equal(radiance, before)


def test_noise_has_no_bias_and_the_variance_of_its_model() -> None:
    options = SensorOptions(read_noise=(0.004, 0.004), shot_noise=(0.001, 0.001))
    signal = np.full((400, 400, 3), 0.4, np.float32)
    noisy = add_noise(np.random.default_rng(0), signal, options)
    variance = 0.4 * 0.001 + 0.004**2
    assert noisy.mean() == pytest.approx(0.4, abs=4 * np.sqrt(variance / signal.size))
    assert noisy.var() == pytest.approx(variance, rel=0.02)
    for level in (0.0, 5.0):  # clipped at black and white
        clipped = add_noise(np.random.default_rng(0), np.full((50, 50, 3), level, np.float32), options)
        assert 0 <= clipped.min() <= clipped.max() <= 1


def test_demosaicing_keeps_colour_gradients_and_the_grey_of_an_unbalanced_mosaic() -> None:
    constant = np.full((16, 20, 3), (0.8, 0.4, 0.1), np.float32)
    np.testing.assert_allclose(demosaic(constant), constant, atol=2e-5)
    ramp = np.repeat(np.linspace(0.1, 0.9, 40, dtype=np.float32)[None, :, None], 3, 2).repeat(20, 0)
    np.testing.assert_allclose(demosaic(ramp)[2:-2, 2:-2], ramp[2:-2, 2:-2], atol=1e-3)
    for seed in range(4):
        taken = sensor.demosaic_unbalanced(np.random.default_rng(seed), np.full((32, 32, 3), 0.2, np.float32))
        np.testing.assert_allclose(taken, np.broadcast_to(taken[:1, :1, 1:2], taken.shape), atol=2e-4)


def test_exposure_reaches_a_photographs_mean_level(radiance: np.ndarray) -> None:
    levels = [expose(np.random.default_rng(seed), 7 * radiance).mean() for seed in range(60)]
    assert np.median(levels) == pytest.approx(0.2, rel=0.3)
    assert np.isfinite(expose(np.random.default_rng(0), np.zeros_like(radiance))).all()


def test_softness_moves_no_light() -> None:
    dot = np.zeros((41, 61, 3), np.float32)
    dot[20, 30] = 1
    weights = np.stack([np.ones((41, 61)), *np.meshgrid(np.arange(61), np.arange(41))])
    for seed in range(30):
        soft = soften(np.random.default_rng(seed), dot, SensorOptions())[..., 0]
        np.testing.assert_allclose((soft * weights).sum((1, 2)), [1, 30, 20], atol=1e-3)


def test_tone_curves_rise_from_black_to_white() -> None:
    ramp = np.linspace(0, 1, 200, dtype=np.float32)
    curves = np.stack([tone(np.random.default_rng(seed), ramp) for seed in range(20)])
    assert (np.diff(curves, axis=1) >= 0).all()
    np.testing.assert_allclose(curves[:, 0], 0, atol=0.01)
    np.testing.assert_allclose(curves[:, -1], 1, atol=1e-5)
    assert (curves[:, 50] > 0.3).all()  # coded for the eye: brighter than linear


def test_jpeg_keeps_red_red() -> None:
    red = np.full((32, 32, 3), (200, 30, 40), np.uint8)
    difference = sensor.compress(np.random.default_rng(0), red).astype(int) - red
    assert np.abs(difference).max() <= 6
