"""Point spreads out of focus: their radius is that of the disc which spreads as widely."""

import numpy as np
import pytest

from tools.rendering.defocus import KINDS, point_spread


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("radius", [3.0, 8.0, 20.0])
def test_spread_is_that_of_a_disc(kind: str, radius: float) -> None:
    for seed in range(5):
        kernel = point_spread(np.random.default_rng(seed), radius, kind)
        reach = len(kernel) // 2
        y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        assert kernel.sum() == pytest.approx(1, abs=1e-4) and kernel.min() >= 0
        spread = np.sqrt((kernel * (x**2 + y**2)).sum() * 2)  # of a disc its radius
        assert spread == pytest.approx(radius, rel=0.2 if kind == "ring" else 0.06)
