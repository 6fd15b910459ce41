"""The likelihood: what parallax gains, both orders summed, which order positive depth says a smear has."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix, homogeneous
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.homography import FieldLikelihood, HomographyFit, fit_homography
from blur2view.two_view.likelihood import NormalisedSmears
from blur2view.two_view.models import FundamentalManifold, HomographyFlow, cayley
from tests.support.scenes import make_scene, normalised_smears

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


def plane_of(A: Array, likelihood: NormalisedSmears) -> HomographyFit:
    field = FieldLikelihood(smears=likelihood)
    return fit_homography(field, HomographyFlow.plane(A.ravel()[:8], likelihood.prior_sigma))


def gain(A: Array, F: Array, ends: Array) -> float:
    return plane_of(A, normalised_smears(ends, NOISE)).parallax_gain(F)


def test_parallax_is_counted_and_a_plane_gains_nothing_from_it() -> None:
    for seed in range(6):
        assert gain(*beside_a_plane(seed, 0.0)) < 6
        assert gain(*beside_a_plane(seed, 0.4)) > 60


def odds(seed: int, rotation_share: float, camera: bool) -> tuple[Array, Array]:
    """Return odds (N,) of the true and of the other order of an exact scene's smears.

    By the camera, or by coordinates of the assumed one, whose focal length is another.
    """
    scene = make_scene(np.random.default_rng(seed), rotation_share=rotation_share)
    likelihood = NormalisedSmears.of(scene.matches(0.01), scene.camera if camera else None)
    K = likelihood.T @ scene.K
    lens = np.array([np.log(K[0, 0]), *K[:2, 2]])
    point = FundamentalManifold(
        t=scene.t / np.linalg.norm(scene.t), R=scene.R, intrinsics=lens, prior_sigma=np.ones(6)
    )
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


def test_both_orders_of_every_smear_are_summed() -> None:
    """A field that no smear tells the order of costs log 2 less than one that all do."""
    A, _, ends = beside_a_plane(6, 0.0)
    plane = plane_of(A, normalised_smears(ends, NOISE))
    family = plane.family.step(-2 * plane.family.parameters)
    backward = HomographyFit(likelihood=plane.likelihood, family=family, slow=plane.slow)
    assert np.allclose(plane.costs, backward.costs)
    decided = 6 * np.log1p((plane.residual**2).sum(axis=0) / 4)
    far = plane.likelihood.smears.matches.length_px > 8
    assert np.isclose(np.median((plane.costs - decided)[far]), 2 * np.log(2), atol=0.05)


def test_the_assumed_camera_lies_about_the_picture_or_without_its_size_about_the_ends() -> None:
    centre = SmearMatches(ends=np.full((1, 2, 2), [319.5, 239.5]), sigma_px=np.ones(1), image_size=(640, 480))
    np.testing.assert_allclose(NormalisedSmears.of(centre).ends, 0, atol=1e-12)
    ends = np.random.default_rng(0).uniform(0, 500, (40, 2, 2))
    here, there = (SmearMatches(ends=ends + shift, sigma_px=np.ones(40)) for shift in (0, [900, -400]))
    np.testing.assert_allclose(NormalisedSmears.of(there).ends, NormalisedSmears.of(here).ends, atol=1e-12)
    assert np.abs(NormalisedSmears.of(here).ends).max() < 1
