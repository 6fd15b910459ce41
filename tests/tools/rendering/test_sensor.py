"""The camera between radiance and photograph."""

import numpy as np
import pytest

from tools.rendering.sensor import photograph


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
