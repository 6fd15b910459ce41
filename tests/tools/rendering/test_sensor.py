"""The camera between radiance and photograph."""

import numpy as np
import pytest

from tools.rendering.sensor import SPREADS, photograph, point_spread


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


@pytest.mark.parametrize("kind", SPREADS)
@pytest.mark.parametrize("radius", [3.0, 8.0, 20.0])
def test_point_spread_is_as_wide_as_a_disc(kind: str, radius: float) -> None:
    for seed in range(5):
        kernel = point_spread(np.random.default_rng(seed), radius, kind)
        reach = len(kernel) // 2
        y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        assert kernel.sum() == pytest.approx(1, abs=1e-4) and kernel.min() >= 0
        spread = np.sqrt((kernel * (x**2 + y**2)).sum() * 2)  # of a disc its radius
        assert spread == pytest.approx(radius, rel=0.2 if kind == "ring" else 0.06)
