"""The camera between radiance and photograph."""

import numpy as np
import pytest

from tools.rendering.sensor import SensorOptions, add_noise, photograph


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
