"""The likelihood: what parallax gains, both orders summed, which order positive depth says a smear has."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix, homogeneous
from blur2view.two_view.homography import HomographyFit, fit_homography
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import CameraF, HomographyFlow, cayley, entries_of
from tests.support.likelihoods import normalised_likelihood
from tests.support.scenes import make_scene

NOISE = 8e-4


def beside_a_plane(seed: int, off: float) -> tuple[Array, Array, Array]:
    """Give A, F and noisy ends of smears of a plane, a share of them moved along their epipolar lines."""
    rng = np.random.default_rng(seed)
    A = 0.02 * rng.normal(size=(3, 3))
    A[2, 2] = 0
    epipole = np.array([0.6, 0.3, 1.0])
    x = rng.uniform(-0.4, 0.4, (600, 2))
    y = homogeneous(x) @ cayley(A).T
    y = y[:, :2] / y[:, 2:]
    apart = (rng.random(600) < off)[:, None] * rng.normal(0, 0.05, (600, 1))
    y = y + apart * (epipole[:2] - y)
    ends = np.stack([x, y], axis=1) + NOISE * rng.normal(size=(600, 2, 2))
    ends[::2] = ends[::2, ::-1]
    return A, cross_matrix(epipole) @ cayley(A), ends


def plane_of(A: Array, likelihood: Likelihood) -> HomographyFit:
    return fit_homography(likelihood, HomographyFlow.plane(A.ravel()[:8], likelihood.prior))


def gain(A: Array, F: Array, ends: Array) -> float:
    return plane_of(A, normalised_likelihood(ends, NOISE)).gain_of_parallax(F)


def test_parallax_is_counted_and_a_plane_gains_nothing_from_it() -> None:
    for seed in range(6):
        assert gain(*beside_a_plane(seed, 0.0)) < 6
        assert gain(*beside_a_plane(seed, 0.4)) > 60


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
    still = HomographyFit(likelihood=likelihood, family=HomographyFlow.plane(np.zeros(8), np.ones(6)))
    assert np.isfinite(still.gain_of_parallax(np.eye(3)))


def odds(seed: int, rotation_share: float, camera: bool) -> tuple[Array, Array]:
    """Return odds (N,) of the true and of the other order of an exact scene's smears.

    By the camera, or by coordinates of the assumed one, whose focal length is another.
    """
    scene = make_scene(np.random.default_rng(seed), rotation_share=rotation_share)
    likelihood = Likelihood.of(scene.matches(0.01), scene.camera if camera else None)
    K = likelihood.T @ scene.K
    lens = np.array([np.log(K[0, 0]), *K[:2, 2]])
    point = CameraF(t=scene.t / np.linalg.norm(scene.t), R=scene.R, lens=lens, sigma=np.ones(6))
    forward, backward = likelihood.order_odds(*point.motion(), 1.0)
    return np.where(scene.swapped, backward, forward), np.where(scene.swapped, forward, backward)


@pytest.mark.parametrize("camera", [True, False], ids=["known", "assumed"])
@pytest.mark.parametrize("rotation_share", [0.0, 0.3, 0.6])
def test_points_in_front_are_likelier_in_their_true_order(rotation_share: float, camera: bool) -> None:
    decided = 0.0
    for seed in range(5):
        true, other = odds(seed, rotation_share, camera)
        clear = np.abs(true - other) > 0.3
        decided += clear.mean() / 5
        assert (true > other)[clear].mean() > 0.999
    assert decided > (0.3 if rotation_share else 0.995)


def smears(middle: Array, displacement: Array) -> Likelihood:
    """Return the likelihood of smears (N, 2) at normalised midpoints (N, 2), all independent."""
    ends = np.stack([middle - displacement / 2, middle + displacement / 2], axis=1)
    return normalised_likelihood(ends, 1e-4)


def turning(*vector: float) -> Array:
    return entries_of(cross_matrix(np.array(vector)))


def test_exchanging_the_ends_or_the_translation_exchanges_the_orders() -> None:
    rng = np.random.default_rng(0)
    turn, t, middle, displacement = (
        turning(*rng.normal(size=3)),
        rng.normal(size=3),
        *rng.normal(size=(2, 9, 2)),
    )
    one, other = (smears(middle, s * displacement) for s in (1, -1))
    assert np.allclose(one.order_odds(turn, t, 1.0)[::-1], other.order_odds(turn, t, 1.0))
    assert np.allclose(one.order_odds(0 * turn, t, -1.0), other.order_odds(0 * turn, t, 1.0))
    assert np.allclose(one.order_odds(turn, t, -1.0), one.order_odds(turn, -t, 1.0))


def test_feasible_orders_share_and_infeasible_ones_are_improbable() -> None:
    sideways, turn = np.array([1.0, 0.0, 0.0]), turning(0.0, 1.0, 0.0)  # by 1 along x
    likelihood = smears(np.zeros((1, 2)), np.array([[0.1, 0.0]]))
    assert np.allclose(likelihood.order_odds(-turn, sideways, 1.0), 0.5, atol=0.01)
    forward, backward = likelihood.order_odds(0 * turn, sideways, 1.0)
    assert forward > 0.95 and backward < 1e-6
    assert likelihood.order_odds(turn, sideways, 1.0).max() < np.exp(-10)
