"""Families of F and local optimisation: derivatives against differences, and what the optimum is."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import unit_norm
from blur2view.geometry.rotation import rotation_matrix
from blur2view.two_view.fundamental import FundamentalFit
from blur2view.two_view.least_squares import levenberg_marquardt
from blur2view.two_view.likelihood import Likelihood, OrderedResiduals
from blur2view.two_view.models import (
    UNROTATED,
    CameraF,
    CameraPrior,
    FundamentalModel,
    GeneralF,
    assumed_camera,
)
from tests.support.likelihoods import normalised_likelihood
from tests.support.scenes import IMAGE_SIZE, make_scene

PRIOR = CameraPrior(rotation=(0.1, 0.1, 0.2))
DIRECTION = np.array([0.6, 0.0, 0.8])
FAMILIES: list[FundamentalModel] = [
    CameraF(t=DIRECTION, R=np.eye(3), spread=UNROTATED),
    GeneralF.from_matrix(np.random.default_rng(0).normal(size=(3, 3))),
    CameraF(t=DIRECTION, R=rotation_matrix(np.array([0.1, 0.2, -0.1])), log_focal=0.1,
            principal=np.array([0.1, -0.05]), spread=PRIOR),
]  # fmt: skip


def normalised(ends: Array) -> Array:
    T = assumed_camera(IMAGE_SIZE)
    return np.asarray(ends * T[0, 0] + T[:2, 2])


def refined(
    point: FundamentalModel,
    likelihood: Likelihood,
    *,
    decided: bool = False,
    steps: int = 20,
    tolerance: float = 1e-5,
) -> FundamentalFit:
    start = FundamentalFit(point=point, likelihood=likelihood)
    if not decided:
        start = FundamentalFit.likelier(point, likelihood)
    *_, best = levenberg_marquardt(start, steps, tolerance)
    return best


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: type(family).__name__)
def test_tangents_are_numeric_derivatives_and_keep_rank_two(family: FundamentalModel) -> None:
    tangent = family.tangent()
    assert tangent.shape[1:] == (3, 3)
    for k, step in enumerate(1e-6 * np.eye(len(family.tangent()))):
        numeric = (family.step(step).matrix() - family.step(-step).matrix()) / 2e-6
        assert np.allclose(numeric, tangent[k], atol=1e-8)
        assert abs(np.linalg.det(family.step(1e5 * step).matrix())) < 1e-12
    residual, jacobian = family.prior()
    assert jacobian.shape == (len(residual), len(tangent))


def test_general_F_keeps_a_matrix_of_rank_two() -> None:
    F = unit_norm(FAMILIES[1].matrix())
    assert np.allclose(GeneralF.from_matrix(F).matrix(), F)


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: type(family).__name__)
def test_gradient_is_the_derivative_of_half_the_cost_prior_included(family: FundamentalModel) -> None:
    ends = normalised(make_scene(np.random.default_rng(6), count=60).ends)
    matches = normalised_likelihood(ends, np.full(60, 0.02), effective_share=0.1)
    state = FundamentalFit.likelier(family, matches)
    normal, gradient = state.normal_equations()
    for k, direction in enumerate(np.eye(len(gradient))):
        ahead, behind = (state.moved(s * 1e-6 * direction).cost for s in (1, -1))
        assert np.isclose((ahead - behind) / 4e-6, gradient[k], rtol=0.05, atol=1e-3)
    of_prior = family.prior()[1]
    rounding = 1e-15 * np.abs(normal).max()
    assert np.linalg.eigvalsh(normal - of_prior.T @ of_prior)[0] > -1e-6 - rounding


def test_refinement_recovers_F_from_unordered_smears() -> None:
    for seed in range(5):
        scene = make_scene(np.random.default_rng(seed), count=400, rotation_share=0.8)
        ends, T = normalised(scene.ends), assumed_camera(IMAGE_SIZE)
        truth = unit_norm(np.linalg.inv(T).T @ scene.F @ np.linalg.inv(T))
        bent = GeneralF.from_matrix(truth).step(np.random.default_rng(seed).normal(0, 1e-3, 7))
        matches = normalised_likelihood(ends, np.full(400, T[0, 0]))
        found = refined(bent, matches, decided=True, steps=50, tolerance=1e-12)
        F = found.point.matrix()
        assert min(np.abs(F - truth).max(), np.abs(F + truth).max()) < 1e-6
        assert found.cost < 1e-6


def test_an_undecided_order_costs_nothing_and_a_decided_one_two_log_two() -> None:
    value, far = np.array([0.3, -2.0]), np.array([50.0, 50.0])
    for both, cost, share in (([value, -value], 0, 0.5), ([value, far], 2 * np.log(2), 1)):
        residuals = OrderedResiduals(both=np.stack(both))
        assert np.allclose(-2 * np.log(residuals.likelihoods.sum(axis=0)), value**2 + cost)
        assert np.allclose(residuals.forward_share, share)
        assert np.allclose(OrderedResiduals(both=residuals.both[::-1]).forward_share, 1 - share)
