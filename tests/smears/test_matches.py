"""Ambiguous matches: building, choosing, spreading."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from blur2view.smears.field import SmearField
from blur2view.smears.matches import SmearMatches
from blur2view.smears.sampling import SelectOptions, select_matches


def field(length_px: float = 10.0, sigma_px: float = 1.0, shape: tuple[int, int] = (96, 128)) -> SmearField:
    displacement = np.zeros((*shape, 2), np.float32)
    displacement[..., 0] = length_px
    return SmearField(displacement=displacement, sigma_px=np.full(shape, sigma_px, np.float32))


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
        {"ends": np.zeros((3, 2)), "sigma_px": np.ones(3)},
        {"ends": np.zeros((3, 2, 2)), "sigma_px": np.ones(2)},
        {"ends": np.full((3, 2, 2), np.nan), "sigma_px": np.ones(3)},
        {"ends": np.zeros((3, 2, 2)), "sigma_px": np.zeros(3)},
        {"ends": np.zeros((3, 2, 2)), "sigma_px": np.ones(3), "image_size": (0, 5)},
        {"ends": np.zeros((3, 2, 2)), "sigma_px": np.ones(3), "still_share": 2.0},
        {"ends": np.zeros((3, 2, 2)), "sigma_px": np.ones(3), "sure_share": -0.1},
        {"ends": np.zeros((3, 2, 2)), "sigma_px": np.ones(3), "across_px": np.zeros(3)},
    ],
)
def test_wrong_matches_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"expected|must be"):
        SmearMatches(**wrong)  # type: ignore[arg-type]


def test_from_points_refuses_different_shapes() -> None:
    with pytest.raises(ValueError, match=r"\(3, 2\) and \(4, 2\)"):
        SmearMatches.from_points(np.zeros((3, 2)), np.zeros((4, 2)))


def test_the_arrays_given_are_not_kept() -> None:
    ends = np.zeros((3, 2, 2))
    matches = SmearMatches(ends=ends, sigma_px=np.ones(3))
    ends[:] = 1
    assert not matches.ends.any()


def test_smears_lie_on_the_network_s_grid_with_their_ends_half_a_smear_away() -> None:
    matches = select_matches(field(), SelectOptions(beta=1.0, max_matches=10_000))
    assert len(matches) == 24 * 32
    assert (matches.midpoint % 4 == 1).all()
    assert np.allclose(matches.displacement, [10, 0])
    assert matches.image_size == (128, 96)
    assert matches.still_share == 0


@pytest.mark.parametrize("rank", ["relative", "absolute"])
def test_the_surest_share_is_kept(rank: str) -> None:
    smears = field()
    sigma = smears.sigma_px.copy()
    sigma[:48] = 0.2
    options = SelectOptions(beta=0.4, rank=rank)  # type: ignore[arg-type]
    matches = select_matches(SmearField(displacement=smears.displacement, sigma_px=sigma), options)
    assert len(matches) == np.ceil(0.4 * 24 * 32)
    assert np.allclose(matches.sigma_px, 0.2)


def test_sure_directions_come_first_where_the_network_tells_them() -> None:
    rng = np.random.default_rng(0)
    displacement = rng.normal(0, 20, (64, 64, 2)).astype(np.float32)
    sigma, direction = 0.3 * rng.random((2, 64, 64), dtype=np.float32)
    told = SmearField(displacement=displacement, sigma_px=sigma, sigma_rad=direction)
    untold = SmearField(displacement=displacement, sigma_px=sigma)
    options = SelectOptions(beta=0.3, min_length_px=0, rank="direction")
    columns, rows = select_matches(told, options).midpoint.astype(int).T
    assert direction[rows, columns].max() <= np.quantile(direction[1::4, 1::4], 0.31)
    absolute = select_matches(told, SelectOptions(beta=0.3, min_length_px=0, rank="absolute"))
    np.testing.assert_array_equal(select_matches(untold, options).ends, absolute.ends)
    assert not np.array_equal(select_matches(told, options).ends, absolute.ends)


def test_relative_rank_prefers_long_smears_absolute_rank_short_ones() -> None:
    smears = field()
    displacement, sigma = smears.displacement.copy(), smears.sigma_px.copy()
    displacement[:, :64], sigma[:, :64] = [40.0, 0.0], 2.0
    both = SmearField(displacement=displacement, sigma_px=sigma)
    relative = select_matches(both, SelectOptions(beta=0.5, rank="relative"))
    absolute = select_matches(both, SelectOptions(beta=0.5, rank="absolute"))
    assert np.allclose(relative.length_px, 40)
    assert np.allclose(absolute.length_px, 10)


def test_few_matches_are_spread_over_the_image() -> None:
    sigma = field().sigma_px.copy()
    sigma[:48, :64] = 0.1  # one quarter is surest; it must not take all
    smears = SmearField(displacement=field().displacement, sigma_px=sigma)
    middle = select_matches(smears, SelectOptions(beta=1.0, max_matches=64, cells=8)).midpoint
    quarters = np.bincount((middle[:, 0] > 64) * 2 + (middle[:, 1] > 48), minlength=4)
    assert len(middle) == 64
    assert (quarters == 16).all()


def test_equally_sure_smears_are_taken_from_everywhere() -> None:
    middle = select_matches(field()).midpoint  # 0.35 of them; once all from the top of the image
    rows = np.bincount((middle[:, 1] // 24).astype(int), minlength=4)
    assert len(middle) == np.ceil(0.35 * 24 * 32)
    assert (rows > 0.2 * len(middle)).all()


@pytest.mark.parametrize("shape", [(480, 640), (640, 480), (400, 400)])
@pytest.mark.parametrize("count", [500, 1000, 2000])
def test_equally_sure_smears_keep_their_distance(shape: tuple[int, int], count: int) -> None:
    middle = select_matches(field(shape=shape), SelectOptions(max_matches=count)).midpoint
    apart = cKDTree(middle).query(middle, 2)[0][:, 1]
    assert len(middle) == count
    assert apart.min() > 0.45 * np.sqrt(shape[0] * shape[1] / count)  # of the distance in a square grid
    cells = np.bincount((8 * middle / shape[::-1]).astype(int) @ np.array([1, 8]), minlength=64)
    assert cells.max() - cells.min() <= 0.25 * cells.mean() + 2


def test_one_match_may_be_asked_for() -> None:
    every = select_matches(field(), SelectOptions(beta=1.0))
    one = select_matches(field(), SelectOptions(beta=1.0, max_matches=1, cells=1))
    np.testing.assert_array_equal(one.ends, every.ends[:1])


def test_a_still_image_gives_no_matches_and_says_so() -> None:
    matches = select_matches(field(length_px=0.2, sigma_px=0.3))
    assert len(matches) == 0
    assert matches.still_share == 1


def test_uncertain_stillness_is_not_counted() -> None:
    assert select_matches(field(length_px=0.2, sigma_px=30.0)).still_share == 0


def test_tiny_images_and_repeats() -> None:
    assert len(select_matches(field(shape=(1, 1)))) == 1
    one, two = select_matches(field()), select_matches(field())
    assert np.array_equal(one.ends, two.ends)


@pytest.mark.parametrize(
    "wrong",
    [
        {"beta": 0.0},
        {"beta": np.nan},
        {"max_matches": 0},
        {"rank": "best"},
        {"sure_rad": 0.0},
        {"still_sigma_px": -1.0},
        {"min_length_px": np.nan},
    ],
)
def test_options_out_of_range_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="must be"):
        SelectOptions(**wrong)  # type: ignore[arg-type]


def test_share_of_sure_directions_and_errors_across_are_told() -> None:
    smears = field()
    direction = np.full(smears.shape, 0.2, np.float32)
    direction[:, 32:] = 0.8
    told = SmearField(displacement=smears.displacement, sigma_px=smears.sigma_px, sigma_rad=direction)
    matches = select_matches(told, SelectOptions(beta=1.0))
    assert matches.sure_share == 0.25
    expected = np.where(matches.midpoint[:, 0] < 32, 0.2, 0.8) * matches.length_px
    assert matches.across_px is not None
    np.testing.assert_allclose(matches.across_px, expected, rtol=1e-5)
    weighed = matches.weighed_across().sigma_px
    assert np.ptp(weighed / matches.across_px) < 1e-9 and np.median(weighed / matches.sigma_px) == 1
    np.testing.assert_array_equal(matches.subset(np.arange(3)).across_px, matches.across_px[:3])
    untold = select_matches(smears, SelectOptions(beta=1.0))
    assert untold.sure_share == 1 and untold.across_px is None and untold.weighed_across() is untold
    np.testing.assert_array_equal(np.unique(untold.sigma_px), np.unique(smears.sigma_px[1::4, 1::4]))


@pytest.mark.parametrize(("sigma_px", "still"), [(2.9, 1.0), (3.1, 0.0)])
def test_short_smears_show_stillness_only_if_they_are_sure(sigma_px: float, still: float) -> None:
    assert select_matches(field(length_px=1.0, sigma_px=sigma_px)).still_share == still
