"""Homographies among smears with known errors: exact, among outliers, with shared errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.rotation import rotation_vector
from blur2view.robust.homography import PlaneH, RotationH
from blur2view.robust.parametrization import CameraPrior
from blur2view.robust.problem import SmearProblem, build_problem
from blur2view.smears.noise import INDEPENDENT, SharedErrors
from blur2view.two_view.flow import LOW_FREQUENCY, FlowData, FlowFit, fit_flow
from tests.support.scenes import IMAGE_SIZE, Scene, disturb, make_scene, with_outliers
from tools.metrics import CHI_SQUARED_90

FIXED = CameraPrior(rotation=(1.0, 1.0, 1.0), log_focal=0.0, principal=0.0)
SLOWLY = SharedErrors(independent_share=1.0, length=0.05, direction_rad=0.03)


def turning(seed: int, count: int = 600) -> Scene:
    return make_scene(np.random.default_rng(seed), count=count, length_px=15, rotation_share=np.inf)


def problem_of(scene: Scene, shared: SharedErrors = INDEPENDENT) -> SmearProblem:
    return build_problem(scene.ends, np.ones(len(scene.ends)), IMAGE_SIZE, scene.camera, shared)


def errors_px(scene: Scene, along: float = 0.5, across: float = 0.5) -> tuple[Array, Array]:
    return np.full(len(scene.ends), along), np.full(len(scene.ends), across)


def start(scene: Scene) -> RotationH:
    wrong = 1.3 * rotation_vector(scene.R) + 0.002
    return RotationH(rotation=wrong, principal=np.zeros(2), spread=FIXED)


def test_a_pure_rotation_is_found_without_orders_though_a_fifth_are_outliers() -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        scene = with_outliers(turning(seed), rng, 0.2)
        fit = fit_flow(start(scene), FlowData.of(problem_of(scene), errors_px(scene)))
        true = rotation_vector(scene.R)
        assert np.linalg.norm(fit.family.rotation - true) < 0.01 * np.linalg.norm(true)
        backward = (fit.sign < 0)[~scene.outlier]
        assert (backward == scene.swapped[~scene.outlier]).mean() > 0.99


def test_a_rotation_finds_turn_and_focal_length() -> None:
    scene = turning(0)
    shorter = scene.K * np.array([[0.8, 1, 1], [1, 0.8, 1], [1, 1, 1]])
    problem = problem_of(replace(scene, K=shorter))
    free = RotationH(
        rotation=rotation_vector(scene.R), principal=np.zeros(2), spread=CameraPrior(rotation=(0.1, 0.1, 0.3))
    )
    found = fit_flow(free, FlowData.of(problem, errors_px(scene, 0.01, 0.01))).family
    assert np.isclose(np.exp(found.log_focal), 1.25, rtol=0.02)
    assert np.allclose(np.abs(found.rotation), np.abs(rotation_vector(scene.R)), atol=1e-3)


def test_its_jacobian_is_the_derivative_of_its_residuals() -> None:
    scene = disturb(turning(1, count=40), np.random.default_rng(1), noise_px=0.5)
    data = FlowData.of(problem_of(scene, SLOWLY), errors_px(scene, 1.0, 0.5))
    fit = FlowFit(data=data, family=start(scene), low_frequency=np.full(LOW_FREQUENCY, 0.1))
    _, gradient = fit.normal_equations()
    step = 1e-6
    for k in range(len(gradient)):
        delta = step * np.eye(len(gradient))[k]
        slope = (fit.moved(delta).cost - fit.moved(-delta).cost) / (4 * step)
        assert slope == pytest.approx(gradient[k], rel=1e-3, abs=1e-2)


def test_errors_all_over_the_picture_do_not_speak_against_a_rotation() -> None:
    """Lengths 6 % too long on one side and too short on the other: any homography gains much, unless told."""
    gains = {}
    for shared in (INDEPENDENT, SLOWLY):
        scene = turning(2)
        middle = scene.ends.mean(axis=1)
        stretch = 1 + 0.06 * (middle[:, 0] / 320 - 1)
        half = 0.5 * (scene.ends[:, 1] - scene.ends[:, 0]) * stretch[:, None]
        wrong = replace(scene, ends=np.stack([middle - half, middle + half], axis=1))
        data = FlowData.of(problem_of(wrong, shared), errors_px(wrong, 0.2, 0.2))
        rotation = fit_flow(start(scene), data)
        plane = fit_flow(PlaneH(entries=rotation.family.generator().ravel()[:8]), data)
        gains[shared] = rotation.cost - plane.cost
    assert gains[INDEPENDENT] > 100
    assert gains[SLOWLY] < 0.1 * gains[INDEPENDENT]


@pytest.mark.slow
def test_regions_hold_the_rotation_where_all_lengths_err_alike() -> None:
    held: list[bool] = []
    without: list[bool] = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        scene = disturb(turning(seed), rng, noise_px=0.2)
        middle = scene.ends.mean(axis=1)
        half = 0.5 * (scene.ends[:, 1] - scene.ends[:, 0]) * (1 + 0.05 * rng.normal())
        wrong = replace(scene, ends=np.stack([middle - half, middle + half], axis=1))
        data = FlowData.of(problem_of(wrong, SLOWLY), errors_px(wrong, 0.4, 0.4))
        fit = fit_flow(start(scene), data.without_low_frequency())
        error = fit.family.rotation - rotation_vector(scene.R)
        for regions, given in ((held, data), (without, data.without_low_frequency())):
            covariance = fit.covariance(1.0, given)[:3, :3]
            regions.append(bool(error @ np.linalg.solve(covariance, error) < CHI_SQUARED_90[3]))
    assert np.mean(held) > 0.75
    assert np.mean(without) < 0.4
