"""Ambiguous matches: building and choosing them."""

from typing import Any

import numpy as np
import pytest

from blur2view.smears.grid import SmearGrid
from blur2view.smears.matches import SelectOptions, SmearMatches, select_matches
from blur2view.smears.noise import NoiseModel


def grid(length_px: float = 10.0, sigma_px: float = 1.0, shape: tuple[int, int] = (384, 512)) -> SmearGrid:
    """Horizontal smears, alike everywhere."""
    size = -(-shape[0] // 32), -(-shape[1] // 32)
    cells = np.broadcast_to(np.array([length_px, 0, sigma_px, 0.1], np.float32), (*size, 4))
    return SmearGrid(cells=cells.copy(), stride=32, shape=shape)


def test_matches_know_midpoints_displacements_and_lengths() -> None:
    matches = SmearMatches.from_points(np.array([[0.0, 0], [1, 1]]), np.array([[3.0, 4], [1, 1]]), 0.5)
    assert len(matches) == 2
    assert np.allclose(matches.midpoint, [[1.5, 2.0], [1.0, 1.0]])
    assert np.allclose(matches.displacement, np.array([[3.0, 4], [0, 0]]))
    assert np.allclose(matches.length_px, [5, 0])
    assert np.allclose(matches.sigma_px, 0.5)
    assert len(matches.subset(np.array([True, False]))) == 1


@pytest.mark.parametrize(
    "wrong",
    [
        {"ends": np.zeros((3, 2))},
        {"sigma_px": np.ones(2)},
        *({"ends": np.full((3, 2, 2), value)} for value in (np.nan, np.inf)),
        *({"sigma_px": np.full(3, value)} for value in (0.0, -1.0, np.nan, np.inf)),
        {"image_size": (0, 5)},
        {"across_px": np.zeros(3)},
    ],
)
def test_wrong_matches_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"expected|must be"):
        SmearMatches(**({"ends": np.zeros((3, 2, 2)), "sigma_px": np.ones(3)} | wrong))


def test_cells_become_matches_with_their_ends_half_a_smear_away() -> None:
    matches = select_matches(grid(), SelectOptions(beta=1.0))
    assert len(matches) == 12 * 16
    assert (matches.midpoint % 32 == 15.5).all()
    assert np.allclose(matches.displacement, [10, 0], atol=1e-5)
    assert matches.image_size == (512, 384)


def test_the_most_certain_share_is_kept() -> None:
    cells = grid().cells.copy()
    cells[:6, :, 2] = 0.2
    matches = select_matches(SmearGrid(cells=cells, stride=32, shape=(384, 512)), SelectOptions(beta=0.4))
    assert len(matches) == np.ceil(0.4 * 12 * 16)
    assert np.allclose(matches.sigma_px, 0.2)


def test_of_large_photographs_every_second_cell_is_taken_and_counts_as_more() -> None:
    every = select_matches(grid(), SelectOptions(beta=1.0))
    some = select_matches(grid(), SelectOptions(beta=1.0, max_matches=60))
    assert len(some) == 6 * 8
    assert (np.diff(np.unique(some.midpoint[:, 0])) == 64).all()
    assert every.shared.effective_share == pytest.approx(1 / 9)
    assert some.shared.effective_share == pytest.approx(4 / 9)
    assert len(select_matches(grid(), SelectOptions(beta=1.0, max_matches=1))) == 1


@pytest.mark.parametrize("wrong", [{"beta": 0.0}, {"beta": np.nan}, {"max_matches": 0}])
def test_options_out_of_range_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must be"):
        SelectOptions(**wrong)


def test_errors_along_and_across_a_smear_make_up_that_of_its_end_point() -> None:
    noise = NoiseModel(inlier=1.0, added_across=0.01)
    sigmas = noise.inlier_sigmas_px(np.array([1.0, 1000.0]), np.full(2, 5.0), np.full(2, 3.0))
    np.testing.assert_allclose(sigmas, [[4, np.hypot(4, 20)], [3, np.hypot(3, 10)]], rtol=1e-4)
