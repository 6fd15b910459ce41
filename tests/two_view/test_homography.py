"""Homographies without orders: exact oracles, numerical Jacobians, swapped ends."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix, homogeneous, unit_norm
from blur2view.two_view.homography import find_plane, fit_homography
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import (
    CameraPrior,
    HomographyFlow,
    assumed_camera,
    cayley,
    chords,
    pixel_homography,
    rotation_of,
    velocity_basis,
)
from tests.support.likelihoods import normalised_likelihood
from tests.support.scenes import IMAGE_SIZE, rotation

SOFT = CameraPrior(rotation=(0.1, 0.1, 0.3))
KNOWN = CameraPrior(rotation=(0.1, 0.1, 0.3), log_focal=0.0, principal=0.0)


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


def up_to_time(found: Array, true: Array) -> float:
    """Greatest difference of the entries, H or its inverse."""
    return min(float(np.abs(found - true).max()), float(np.abs(found + true).max()))


def test_cayley_of_minus_A_is_the_inverse() -> None:
    A = plane(0, size=0.1).A
    assert np.allclose(cayley(A) @ cayley(-A), np.eye(3), atol=1e-14)


def test_rotation_family_holds_exactly_the_rotations() -> None:
    K = np.array([[1.1, 0, 0.02], [0, 1.1, -0.01], [0, 0, 1]])
    axis, angle = np.array([0.6, 0.0, 0.8]), 0.2
    parameters = np.concatenate([2 * np.tan(angle / 2) * axis, [np.log(1.1)], K[:2, 2]])
    family = HomographyFlow(parameters=parameters, turns=True, spread=SOFT)
    assert np.allclose(cayley(family.generator()), K @ rotation(angle * axis) @ np.linalg.inv(K), atol=1e-14)


def test_start_of_the_rotation_is_the_skew_part() -> None:
    w = np.array([0.01, -0.02, 0.03])
    assert np.allclose(rotation_of(cross_matrix(w)), w)


@pytest.mark.parametrize(
    "field",
    [
        HomographyFlow.plane(plane(1).A.ravel()[:8], SOFT),
        HomographyFlow(parameters=np.array([0.02, 0.03, -0.05, 0.2, 0.03, -0.02]), turns=True, spread=SOFT),
    ],
)
def test_derivatives_match_differences(field: HomographyFlow) -> None:
    step, points = 1e-6, plane(6).likelihood.middle
    for one in (field, field.rolling()):
        derivatives = one.derivatives(velocity_basis(points), points)
        assert len(derivatives) == len(one.parameters) == len(one.weight)
        for i, direction in enumerate(step * np.eye(len(one.parameters))):
            ahead, behind = one.step(direction), one.step(-direction)
            moved = (ahead.displacement(points) - behind.displacement(points)) / (2 * step)
            assert np.allclose(derivatives[i], moved.T, atol=1e-3)
            if i < len(one.tangent()):
                numeric = (ahead.generator() - behind.generator()) / (2 * step)
                assert np.allclose(one.tangent()[i], numeric, atol=1e-8)


def test_a_chord_is_that_of_the_homography_to_fifth_order() -> None:
    errors = []
    for size in (0.04, 0.02):
        scene = plane(3, size=size)
        d = np.where(scene.swapped[:, None], -1, 1) * scene.likelihood.displacement
        errors.append(np.abs(chords(scene.A, scene.likelihood.middle) - d).max())
    assert errors[0] < 1e-5
    assert errors[1] < errors[0] / 16


def test_the_sign_of_A_is_the_order_of_the_ends() -> None:
    scene = plane(4)
    assert np.allclose(chords(-scene.A, scene.likelihood.middle), -chords(scene.A, scene.likelihood.middle))


def test_distances_have_the_standard_deviation_of_a_sampson_distance() -> None:
    scene = plane(5, size=0.03, count=4000, noise=1e-3)
    fit = fit_homography(HomographyFlow.plane(scene.A.ravel()[:8], SOFT), scene.likelihood)
    distance = fit.orders(scene.likelihood).least
    assert np.isclose(np.sqrt((distance**2).mean() / 2), 1.0, rtol=0.05)
    assert (fit.orders(scene.likelihood).backward == scene.swapped).mean() > 0.97


def test_a_rolling_rotation_is_a_rotation_whose_change_is_zero() -> None:
    still = HomographyFlow.rotation(np.array([0.02, 0.03, -0.05]), SOFT)
    points = plane(6).likelihood.middle
    rolling = still.rolling()
    assert np.allclose(rolling.displacement(points), still.displacement(points))
    turning = rolling.step(np.append(np.zeros(6), 0.1 * still.parameters[:3]))
    expected = still.displacement(points) * (1 + 0.1 * points[:, 1:])
    assert np.allclose(turning.displacement(points), expected, atol=1e-5)


def test_velocity_is_the_displacement_to_second_order() -> None:
    scene = plane(6, size=0.01)
    middle = scene.likelihood.middle
    d = scene.likelihood.displacement.copy()
    d[scene.swapped] *= -1
    assert np.abs(np.tensordot(scene.A.ravel()[:8], velocity_basis(middle), 1).T - d).max() < 2e-6


@pytest.mark.parametrize(("noise", "outliers", "within"), [(0.0, 0.0, 1e-4), (6e-4, 0.4, 3e-3)])
def test_a_homography_is_found_though_some_orders_are_wrong(
    noise: float, outliers: float, within: float
) -> None:
    for seed in range(10, 20):
        scene = plane(seed, count=400, noise=noise, outliers=outliers)
        likelihood = replace(scene.likelihood, has_camera=seed % 2 == 0)
        wrong = np.random.default_rng(seed).random(400) < 0.2
        found = find_plane(likelihood, np.zeros(3), [scene.swapped ^ wrong])
        assert up_to_time(found.family.generator(), scene.A) < within


def test_pixel_homography_maps_pixels() -> None:
    scene, T = plane(8), assumed_camera(IMAGE_SIZE)
    H = pixel_homography(scene.A, T)
    assert np.isclose(np.linalg.norm(H), 1)
    pixels = homogeneous(scene.likelihood.ends.reshape(-1, 2)) @ np.linalg.inv(T).T
    x, y = pixels.reshape(-1, 2, 3).swapaxes(0, 1)
    x, y = np.where(scene.swapped[:, None], y, x), np.where(scene.swapped[:, None], x, y)
    mapped = x @ H.T
    assert np.allclose(mapped[:, :2] / mapped[:, 2:], y[:, :2], atol=1e-9)
    assert np.allclose(pixel_homography(-scene.A, T), unit_norm(np.asarray(np.linalg.inv(H))), atol=1e-12)
