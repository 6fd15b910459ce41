"""The smear of a photograph as a whole."""

import numpy as np
import pytest

from blur2view.smears.sharpness import median_smear
from tests.support.grids import grid_of


def test_median_smear_has_one_direction_whatever_the_signs() -> None:
    rng = np.random.default_rng(0)
    signs = rng.choice([-1.0, 1.0], (40, 60, 1))
    for angle in (1.0, 90.0, 179.0):
        phi = np.radians(angle)
        found = median_smear(grid_of(signs * 7 * np.array([np.cos(phi), np.sin(phi)]), 1.0))
        assert found is not None and found.length_px == pytest.approx(7, rel=1e-4)
        assert found.direction_deg == pytest.approx(angle, abs=1e-3) and found.sharpness == pytest.approx(
            1 / 8
        )


def test_what_shows_no_texture_has_no_say() -> None:
    displacement, sigma = np.zeros((64, 64, 2)), np.full((64, 64), 1000.0)
    assert median_smear(grid_of(displacement, sigma)) is None
    displacement[:, :16], sigma[:, :16] = (9.0, 0.0), 2.0
    found = median_smear(grid_of(displacement, sigma))
    assert found is not None and found.length_px == pytest.approx(9)
