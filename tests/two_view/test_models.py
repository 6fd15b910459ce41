"""Models of motion: derivatives against differences, homographies found among wrong orders."""

from dataclasses import dataclass

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import homogeneous
from blur2view.geometry.pose import rotation_matrix
from blur2view.two_view.fundamental import FundamentalFit
from blur2view.two_view.homography import FieldLikelihood, find_plane
from blur2view.two_view.likelihood import NormalisedSmears
from blur2view.two_view.models import (
    UNROTATED,
    FundamentalManifold,
    HomographyFlow,
    assumed_camera,
    cayley,
    velocity_basis,
)
from tests.support.scenes import IMAGE_SIZE, make_scene, normalised_smears

SOFT = np.array([0.1, 0.1, 0.3, 0.3, 0.03, 0.03])
DIRECTION = np.array([0.6, 0.0, 0.8])
CAMERAS = [
    FundamentalManifold(t=DIRECTION, R=np.eye(3), prior_sigma=UNROTATED),
    FundamentalManifold(t=DIRECTION, R=rotation_matrix(np.array([0.1, 0.2, -0.1])),
                        intrinsics=np.array([0.1, 0.1, -0.05]), prior_sigma=SOFT),
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Plane:
    """Smears of one homography H = cayley(A), orders drawn at random, in normalised coordinates."""

    A: Array
    smears: NormalisedSmears
    swapped: np.ndarray


def plane(
    seed: int, size: float = 0.03, count: int = 200, noise: float = 0.0, outliers: float = 0.0
) -> Plane:
    rng = np.random.default_rng(seed)
    A = size * rng.normal(size=(3, 3))
    A[2, 2] = 0
    points = rng.uniform([-0.4, -0.3], [0.4, 0.3], (count, 2))
    moved = homogeneous(points) @ cayley(A).T
    ends = np.stack([points, moved[:, :2] / moved[:, 2:]], axis=1)
    wrong = rng.random(count) < outliers
    ends[wrong, 1] = ends[wrong, 0] + size * rng.normal(size=(wrong.sum(), 2))
    ends += noise * rng.normal(size=ends.shape)
    swapped = rng.random(count) < 0.5
    ends[swapped] = ends[swapped, ::-1]
    return Plane(A=A, smears=normalised_smears(ends, max(noise, 1e-4)), swapped=swapped)


def normalised(ends: Array) -> Array:
    T = assumed_camera(IMAGE_SIZE)
    return np.asarray(ends * T[0, 0] + T[:2, 2])


@pytest.mark.parametrize("camera", CAMERAS, ids=["translation", "camera"])
def test_tangents_of_F_are_numeric_derivatives_and_keep_rank_two(camera: FundamentalManifold) -> None:
    for k, step in enumerate(1e-6 * np.eye(8)):
        numeric = (camera.step(step).matrix() - camera.step(-step).matrix()) / 2e-6
        assert np.allclose(numeric, camera.tangent()[k], atol=1e-8)
        assert abs(np.linalg.det(camera.step(1e5 * step).matrix())) < 1e-12


@pytest.mark.parametrize("camera", CAMERAS, ids=["translation", "camera"])
def test_gradient_is_the_derivative_of_half_the_cost_prior_included(camera: FundamentalManifold) -> None:
    ends = normalised(make_scene(np.random.default_rng(6), count=60).ends)
    likelihood = normalised_smears(ends, np.full(60, 0.02), effective_share=0.1)
    state = FundamentalFit.likelier(camera, likelihood)
    _, gradient = state.normal_equations()
    for k, direction in enumerate(np.eye(len(gradient))):
        ahead, behind = (state.moved(s * 1e-6 * direction).cost for s in (1, -1))
        assert np.isclose((ahead - behind) / 4e-6, gradient[k], rtol=0.05, atol=1e-3)


@pytest.mark.parametrize(
    "field",
    [
        HomographyFlow.plane(plane(1).A.ravel()[:8], SOFT),
        HomographyFlow(
            parameters=np.array([0.02, 0.03, -0.05, 0.2, 0.03, -0.02]), turns=True, prior_sigma=SOFT
        ),
    ],
    ids=["plane", "rotation"],
)
def test_derivatives_of_fields_match_differences(field: HomographyFlow) -> None:
    step, points = 1e-6, plane(6).smears.middle
    for one in (field, field.rolling(1)):
        derivatives = one.derivatives(velocity_basis(points), points)
        assert len(derivatives) == len(one.parameters) == len(one.weight)
        for i, direction in enumerate(step * np.eye(len(one.parameters))):
            ahead, behind = one.step(direction), one.step(-direction)
            moved = (ahead.displacement(points) - behind.displacement(points)) / (2 * step)
            assert np.allclose(derivatives[i], moved.T, atol=1e-3)


@pytest.mark.parametrize(("noise", "outliers", "within"), [(0.0, 0.0, 1e-4), (6e-4, 0.4, 3e-3)])
def test_a_homography_is_found_though_some_orders_are_wrong(
    noise: float, outliers: float, within: float
) -> None:
    for seed in range(10, 20):
        scene = plane(seed, count=400, noise=noise, outliers=outliers)
        likelihood = FieldLikelihood(smears=scene.smears)
        wrong = np.random.default_rng(seed).random(400) < 0.2
        found = find_plane(likelihood, np.zeros(8), scene.swapped ^ wrong).family.generator()
        assert min(np.abs(found - scene.A).max(), np.abs(found + scene.A).max()) < within
