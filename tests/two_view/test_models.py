"""Models of motion: exact oracles, derivatives against differences, swapped ends."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix, homogeneous, unit_norm
from blur2view.geometry.rotation import rotation_matrix
from blur2view.two_view.fundamental import FundamentalFit
from blur2view.two_view.homography import find_plane, fit_homography
from blur2view.two_view.least_squares import levenberg_marquardt
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import (
    UNROTATED,
    CameraF,
    HomographyFlow,
    assumed_camera,
    cayley,
    chords,
    pixel_homography,
    rotation_of,
    velocity_basis,
)
from tests.support.likelihoods import normalised_likelihood
from tests.support.scenes import IMAGE_SIZE, make_scene

SOFT = np.array([0.1, 0.1, 0.3, 0.3, 0.03, 0.03])
DIRECTION = np.array([0.6, 0.0, 0.8])
CAMERAS = [
    CameraF(t=DIRECTION, R=np.eye(3), sigma=UNROTATED),
    CameraF(t=DIRECTION, R=rotation_matrix(np.array([0.1, 0.2, -0.1])), lens=np.array([0.1, 0.1, -0.05]),
            sigma=SOFT),
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Plane:
    """Smears of one homography H = cayley(A), orders drawn at random, in normalised coordinates."""

    A: Array
    likelihood: Likelihood
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
    return Plane(A=A, likelihood=normalised_likelihood(ends, max(noise, 1e-4)), swapped=swapped)


def normalised(ends: Array) -> Array:
    T = assumed_camera(IMAGE_SIZE)
    return np.asarray(ends * T[0, 0] + T[:2, 2])


@pytest.mark.parametrize("camera", CAMERAS, ids=["translation", "camera"])
def test_tangents_of_F_are_numeric_derivatives_and_keep_rank_two(camera: CameraF) -> None:
    for k, step in enumerate(1e-6 * np.eye(8)):
        numeric = (camera.step(step).matrix() - camera.step(-step).matrix()) / 2e-6
        assert np.allclose(numeric, camera.tangent()[k], atol=1e-8)
        assert abs(np.linalg.det(camera.step(1e5 * step).matrix())) < 1e-12


@pytest.mark.parametrize("camera", CAMERAS, ids=["translation", "camera"])
def test_gradient_is_the_derivative_of_half_the_cost_prior_included(camera: CameraF) -> None:
    ends = normalised(make_scene(np.random.default_rng(6), count=60).ends)
    likelihood = normalised_likelihood(ends, np.full(60, 0.02), effective_share=0.1)
    state = FundamentalFit.likelier(camera, likelihood)
    _, gradient = state.normal_equations()
    for k, direction in enumerate(np.eye(len(gradient))):
        ahead, behind = (state.moved(s * 1e-6 * direction).cost for s in (1, -1))
        assert np.isclose((ahead - behind) / 4e-6, gradient[k], rtol=0.05, atol=1e-3)


def test_refinement_recovers_F_from_unordered_smears() -> None:
    free = np.full(6, 10.0)
    for seed in range(5):
        scene = make_scene(np.random.default_rng(seed), count=400, rotation_share=0.8)
        ends, T = normalised(scene.ends), assumed_camera(IMAGE_SIZE)
        truth = unit_norm(np.linalg.inv(T).T @ scene.F @ np.linalg.inv(T))
        K = T @ scene.K
        lens = np.array([np.log(K[0, 0]), *K[:2, 2]])
        exact = CameraF(t=scene.t / np.linalg.norm(scene.t), R=scene.R, lens=lens, sigma=free)
        bent = exact.step(np.random.default_rng(seed).normal(0, 1e-3, 8))
        start = FundamentalFit(point=bent, likelihood=normalised_likelihood(ends, np.full(400, T[0, 0])))
        *_, found = levenberg_marquardt(start, 50, 1e-12)
        F = unit_norm(found.point.matrix())
        assert min(np.abs(F - truth).max(), np.abs(F + truth).max()) < 1e-4


def test_rotation_family_holds_exactly_the_rotations() -> None:
    K = np.array([[1.1, 0, 0.02], [0, 1.1, -0.01], [0, 0, 1]])
    axis, angle = np.array([0.6, 0.0, 0.8]), 0.2
    parameters = np.concatenate([2 * np.tan(angle / 2) * axis, [np.log(1.1)], K[:2, 2]])
    family = HomographyFlow(parameters=parameters, turns=True, sigma=SOFT)
    exact = K @ rotation_matrix(angle * axis) @ np.linalg.inv(K)
    assert np.allclose(cayley(family.generator()), exact, atol=1e-14)
    assert np.allclose(rotation_of(cross_matrix(axis)), axis)


@pytest.mark.parametrize(
    "field",
    [
        HomographyFlow.plane(plane(1).A.ravel()[:8], SOFT),
        HomographyFlow(parameters=np.array([0.02, 0.03, -0.05, 0.2, 0.03, -0.02]), turns=True, sigma=SOFT),
    ],
    ids=["plane", "rotation"],
)
def test_derivatives_of_fields_match_differences(field: HomographyFlow) -> None:
    step, points = 1e-6, plane(6).likelihood.middle
    for one in (field, field.rolling(1)):
        derivatives = one.derivatives(velocity_basis(points), points)
        assert len(derivatives) == len(one.parameters) == len(one.weight)
        for i, direction in enumerate(step * np.eye(len(one.parameters))):
            ahead, behind = one.step(direction), one.step(-direction)
            moved = (ahead.displacement(points) - behind.displacement(points)) / (2 * step)
            assert np.allclose(derivatives[i], moved.T, atol=1e-3)


def test_a_chord_is_that_of_the_homography_to_fifth_order_and_its_sign_is_the_order() -> None:
    errors = []
    for size in (0.04, 0.02):
        scene = plane(3, size=size)
        d, middle = scene.likelihood.displacement, scene.likelihood.middle
        d = np.where(scene.swapped[:, None], -1, 1) * d
        errors.append(np.abs(chords(scene.A, middle) - d).max())
        assert np.allclose(chords(-scene.A, middle), -chords(scene.A, middle))
    assert errors[0] < 1e-5
    assert errors[1] < errors[0] / 16


@pytest.mark.parametrize("axis", [0, 1])
def test_a_rolling_rotation_is_a_rotation_that_grows_down_the_rows(axis: int) -> None:
    still, points = HomographyFlow.rotation(np.array([0.02, 0.03, -0.05]), SOFT), plane(6).likelihood.middle
    rolling = still.rolling(axis)
    assert np.allclose(rolling.displacement(points), still.displacement(points))
    turning = rolling.step(np.append(np.zeros(6), 0.1 * still.parameters[:3]))
    expected = still.displacement(points) * (1 + 0.1 * points[:, [axis]])
    assert np.allclose(turning.displacement(points), expected, atol=1e-5)


@pytest.mark.parametrize(("noise", "outliers", "within"), [(0.0, 0.0, 1e-4), (6e-4, 0.4, 3e-3)])
def test_a_homography_is_found_though_some_orders_are_wrong(
    noise: float, outliers: float, within: float
) -> None:
    for seed in range(10, 20):
        scene = plane(seed, count=400, noise=noise, outliers=outliers)
        likelihood = replace(scene.likelihood, has_camera=seed % 2 == 0)
        wrong = np.random.default_rng(seed).random(400) < 0.2
        found = find_plane(likelihood, np.zeros(8), scene.swapped ^ wrong).family.generator()
        assert min(np.abs(found - scene.A).max(), np.abs(found + scene.A).max()) < within


def test_distances_of_a_field_have_the_standard_deviation_of_a_sampson_distance() -> None:
    scene = plane(5, size=0.03, count=4000, noise=1e-3)
    fit = fit_homography(scene.likelihood, HomographyFlow.plane(scene.A.ravel()[:8], SOFT))
    orders = fit.orders(scene.likelihood)
    assert np.isclose(np.sqrt((orders.least**2).mean() / 2), 1.0, rtol=0.05)
    assert (orders.backward == scene.swapped).mean() > 0.97


def test_pixel_homography_maps_pixels() -> None:
    scene, T = plane(8), assumed_camera(IMAGE_SIZE)
    H = pixel_homography(scene.A, T)
    pixels = homogeneous(scene.likelihood.ends.reshape(-1, 2)) @ np.linalg.inv(T).T
    x, y = pixels.reshape(-1, 2, 3).swapaxes(0, 1)
    x, y = np.where(scene.swapped[:, None], y, x), np.where(scene.swapped[:, None], x, y)
    mapped = x @ H.T
    assert np.allclose(mapped[:, :2] / mapped[:, 2:], y[:, :2], atol=1e-9)
    assert np.allclose(pixel_homography(-scene.A, T), unit_norm(np.asarray(np.linalg.inv(H))), atol=1e-12)
