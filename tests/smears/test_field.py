"""Smears: double angle, ends and resampling against closed forms."""

import numpy as np
import pytest

from blur2view.smears.grid import from_double_angle, smear_ends, to_double_angle, upsample_grid


def random_displacements(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(scale=20.0, size=(500, 2))


def test_double_angle_matches_textbook_angles_and_is_blind_to_sign() -> None:
    phi = np.radians([0, 30, 45, 90, 135])
    d = 8 * np.stack([np.cos(phi), np.sin(phi)], -1)
    expected = 8 * np.stack([np.cos(2 * phi), np.sin(2 * phi)], -1)
    np.testing.assert_allclose(to_double_angle(d), expected, atol=1e-12)
    np.testing.assert_array_equal(to_double_angle(d), to_double_angle(-d))


def test_double_angle_round_trip_returns_the_half_plane_of_non_negative_x() -> None:
    d = random_displacements()
    back = from_double_angle(to_double_angle(d))
    assert (back[:, 0] >= 0).all()
    np.testing.assert_allclose(back, d * np.sign(d[:, :1]), atol=1e-9)


def test_ends_are_half_a_displacement_away_and_flip_with_the_smear() -> None:
    np.testing.assert_array_equal(smear_ends([[10.0, 20.0]], [[4.0, -2.0]]), [[[8.0, 21.0], [12.0, 19.0]]])
    points, d = random_displacements(1), random_displacements(2)
    np.testing.assert_array_equal(smear_ends(points, -d), smear_ends(points, d)[:, ::-1])
    with pytest.raises(ValueError, match=r"\(1, 2\) and \(2, 2\)"):
        smear_ends(np.zeros((1, 2)), np.zeros((2, 2)))


@pytest.mark.parametrize("stride", [1, 2, 4])
def test_upsampling_a_ramp_puts_cell_centres_where_the_convention_says(stride: int) -> None:
    centres = stride * np.arange(12) + (stride - 1) / 2
    grid = np.stack(np.meshgrid(centres, centres[:9]), -1).astype(np.float32)  # (9, 12, 2): its own x, y
    pixels = upsample_grid(grid, stride)
    inner = slice(stride, -stride)
    x, y = np.meshgrid(np.arange(12 * stride), np.arange(9 * stride))
    np.testing.assert_allclose(pixels[inner, inner, 0], x[inner, inner], atol=1e-4)
    np.testing.assert_allclose(pixels[inner, inner, 1], y[inner, inner], atol=1e-4)
    assert upsample_grid(grid[..., :1], stride).shape == (9 * stride, 12 * stride, 1)
