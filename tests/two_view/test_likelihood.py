"""The likelihood: mixtures, what parallax gains, orders, calibrated cameras with distortion."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix, homogeneous
from blur2view.two_view.homography import HomographyFit, fit_homography
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import CameraPrior, HomographyFlow, cayley
from tests.support.likelihoods import normalised_likelihood

NOISE = 8e-4
SOFT = CameraPrior(rotation=(1.0, 1.0, 1.0))


def beside_a_plane(seed: int, off: float, count: int = 600) -> tuple[Array, Array, Array]:
    """Give A, F and noisy ends of smears of a plane, a share of them moved along their epipolar lines."""
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
    return A, cross_matrix(epipole) @ cayley(A), ends


def plane_of(A: Array, likelihood: Likelihood) -> HomographyFit:
    return fit_homography(HomographyFlow.plane(A.ravel()[:8], likelihood.prior), likelihood)


def gain(A: Array, F: Array, ends: Array, sigma: float = NOISE) -> float:
    return plane_of(A, normalised_likelihood(ends, sigma)).gain_of_parallax(F)


def test_parallax_is_counted_and_a_plane_gains_nothing_from_it() -> None:
    for seed in range(6):
        A, F, ends = beside_a_plane(seed, 0.0)
        assert gain(A, F, ends) < 6
        A, F, ends = beside_a_plane(seed, 0.4)
        assert gain(A, F, ends) > 60


def test_a_wrong_F_gains_less_than_the_true_one() -> None:
    A, F, ends = beside_a_plane(3, 0.4)
    wrong = cross_matrix(np.array([-0.5, 0.9, 1.0])) @ cayley(A)
    assert gain(A, wrong, ends) < 0.3 * gain(A, F, ends)


def test_distances_from_the_lines_are_those_of_F_not_of_the_field() -> None:
    """A homography that errs across the lines: F explains every smear all the same."""
    A, F, ends = beside_a_plane(3, 0.0)
    plane = plane_of(A, normalised_likelihood(ends, NOISE))
    shifted = plane.family.step(np.array([0, 0, 6 * NOISE, 0, 0, 6 * NOISE, 0, 0]))
    assert HomographyFit(likelihood=plane.likelihood, family=shifted).gain_of_parallax(F) > 100


def test_order_transpose_and_time_do_not_matter() -> None:
    A, F, ends = beside_a_plane(4, 0.3)
    gains = [gain(*models, e) for models in ((A, F), (A, F.T), (-A, F)) for e in (ends, ends[:, ::-1])]
    assert np.ptp(gains) < 0.02 * gains[0]


def test_both_orders_of_every_smear_are_summed() -> None:
    """A field that no smear tells the order of costs log 2 less than one that all do."""
    A, _, ends = beside_a_plane(6, 0.0)
    plane = plane_of(A, normalised_likelihood(ends, NOISE))
    family = plane.family.step(-2 * plane.family.parameters)
    backward = HomographyFit(likelihood=plane.likelihood, family=family, slow=plane.slow)
    assert np.allclose(plane.costs, backward.costs)
    decided = 6 * np.log1p((plane.residual**2).sum(axis=0) / 4)
    far = plane.likelihood.length_px > 8
    assert np.isclose(np.median((plane.costs - decided)[far]), 2 * np.log(2), atol=0.05)


@pytest.mark.parametrize("length", [0.0, 1e-9])
def test_smears_without_length_break_nothing(length: float) -> None:
    ends = np.random.default_rng(0).uniform(-0.4, 0.4, (50, 1, 2)).repeat(2, axis=1)
    ends[:, 1, 0] += length
    likelihood = normalised_likelihood(ends, NOISE)
    still = HomographyFit(likelihood=likelihood, family=HomographyFlow.plane(np.zeros(8), SOFT))
    assert np.isfinite(still.gain_of_parallax(np.eye(3)))
