"""Likelihood of parallax: nested models, known mixtures, what the gain says of planes and of depth."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix, homogeneous
from blur2view.robust.homography import cayley
from blur2view.robust.residuals import WeightedEnds
from blur2view.two_view.parallax import chance_densities, mixture, parallax_evidence

UNIT_PX = 768.0
NOISE = 0.6 / UNIT_PX


def beside_a_plane(seed: int, off: float, count: int = 600) -> tuple[Array, Array, WeightedEnds]:
    """Give A, F and noisy smears of a plane, a share of them moved along their epipolar lines."""
    rng = np.random.default_rng(seed)
    A = 0.02 * rng.normal(size=(3, 3))
    A[2, 2] = 0
    epipole = np.array([0.6, 0.3, 1.0])
    x = rng.uniform(-0.4, 0.4, (count, 2))
    y = homogeneous(x) @ cayley(A).T
    y = y[:, :2] / y[:, 2:]
    apart = (rng.random(count) < off)[:, None] * rng.normal(0, 0.05, (count, 1))
    y = y + apart * (epipole[:2] - y)
    ends = np.stack([x, y], axis=1) + NOISE * rng.normal(size=(count, 2, 2))
    ends[::2] = ends[::2, ::-1]
    F = cross_matrix(epipole) @ cayley(A)
    return A, F, WeightedEnds(ends=ends, sigma=np.full(count, NOISE))


def test_mixture_finds_known_weights() -> None:
    rng = np.random.default_rng(0)
    which = rng.random(20000) < 0.3
    x = np.where(which, rng.normal(0, 1, 20000), rng.normal(0, 5, 20000))
    density = np.stack([np.exp(-0.5 * (x / s) ** 2) / (s * np.sqrt(2 * np.pi)) for s in (1.0, 5.0)], axis=1)
    weights, log_density = mixture(density)
    assert np.isclose(weights.sum(), 1)
    assert np.allclose(weights, [0.3, 0.7], atol=0.03)
    assert np.allclose(log_density, np.log(density @ weights))


def test_more_rounds_never_lower_the_likelihood() -> None:
    density = np.random.default_rng(1).uniform(0.01, 1, (500, 6))
    first, low = mixture(density)
    _, high = mixture(density, first)
    assert high.sum() >= low.sum()


def test_parallax_is_counted_and_a_plane_gains_nothing_from_it() -> None:
    for seed in range(10):
        plane, beside = (parallax_evidence(*beside_a_plane(seed, off), UNIT_PX) for off in (0.0, 0.4))
        assert plane.gain < 20 and plane.on_plane > 0.95 and plane.parallax < 0.1
        assert beside.gain > 400 and 0.25 < beside.parallax < 0.55 and 0.55 < beside.on_plane < 0.8


def test_a_wrong_F_gains_less_than_the_true_one() -> None:
    A, F, matches = beside_a_plane(3, 0.4)
    wrong = cross_matrix(np.array([-0.5, 0.9, 1.0])) @ cayley(A)
    gains = [parallax_evidence(A, f, matches, UNIT_PX).gain for f in (F, wrong)]
    assert gains[1] < 0.2 * gains[0]


def test_distances_from_the_lines_are_those_of_F_not_of_the_homography() -> None:
    """A homography that errs across the lines: F explains every smear all the same."""
    for seed in range(5):
        A, F, matches = beside_a_plane(seed, 0.0)
        shifted = A.copy()
        shifted[:2, 2] += 4 * NOISE
        evidence = parallax_evidence(shifted, F, matches, UNIT_PX)
        assert evidence.gain > 500
        assert evidence.parallax > 0.5


def test_order_transpose_and_time_do_not_matter() -> None:
    A, F, matches = beside_a_plane(4, 0.3)
    turned = WeightedEnds(ends=matches.ends[:, ::-1], sigma=matches.sigma)
    gains = [
        parallax_evidence(*models, smears, UNIT_PX).gain
        for models in ((A, F), (A, F.T), (-A, F))
        for smears in (matches, turned)
    ]
    assert np.ptp(gains) < 0.01 * gains[0]  # a midpoint is no end of a smear: A and -A differ slightly


def test_standard_deviations_may_be_off_by_a_factor() -> None:
    A, F, matches = beside_a_plane(5, 0.3)
    for factor in (0.5, 2.0):
        wrong = WeightedEnds(ends=matches.ends, sigma=factor * matches.sigma)
        assert parallax_evidence(A, F, wrong, UNIT_PX).gain > 250
        none = beside_a_plane(5, 0.0)[2]
        none = WeightedEnds(ends=none.ends, sigma=factor * none.sigma)
        assert parallax_evidence(A, F, none, UNIT_PX).gain < 25


def test_chance_densities_are_densities_over_discs() -> None:
    length = np.concatenate([np.full(10**5, 10.0), np.linspace(0, 20, 4001)])  # 10 is the 95 % quantile
    fine = length[-4001:]
    for density in chance_densities(length):
        assert np.isclose(np.trapezoid((2 * np.pi * fine * density[-4001:]), fine), 1, atol=0.02)
        assert (density > 0).all()


@pytest.mark.parametrize("length", [0.0, 1e-9])
def test_smears_without_length_break_nothing(length: float) -> None:
    ends = np.random.default_rng(0).uniform(-0.4, 0.4, (50, 1, 2)).repeat(2, axis=1)
    ends[:, 1, 0] += length
    matches = WeightedEnds(ends=ends, sigma=np.full(50, NOISE))
    evidence = parallax_evidence(np.zeros((3, 3)), np.eye(3), matches, UNIT_PX)
    assert np.isfinite(evidence.gain)
