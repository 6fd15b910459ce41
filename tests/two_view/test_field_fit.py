"""Displacement fields among smears with known errors: exact, among outliers, with errors all over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blur2view.geometry.pose import rotation_vector
from blur2view.smears.noise import INDEPENDENT, NoiseModel
from blur2view.two_view.homography import SLOW, FieldLikelihood, HomographyFit, fit_homography
from blur2view.two_view.likelihood import NormalisedSmears
from blur2view.two_view.models import HomographyFlow
from tests.support.scenes import Scene, disturb, make_scene
from tools.metrics import CHI_SQUARED_90

FIXED = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
SLOWLY = NoiseModel(length=0.05, direction_rad=0.03)


def turning(seed: int, count: int = 600) -> Scene:
    return make_scene(np.random.default_rng(seed), count=count, length_px=15, rotation_share=np.inf)


def likelihood_of(scene: Scene, sigma_px: float = 1.0, shared: NoiseModel = INDEPENDENT) -> FieldLikelihood:
    return FieldLikelihood(smears=NormalisedSmears.of(scene.matches(sigma_px, shared=shared), scene.camera))


def start(scene: Scene) -> HomographyFlow:
    return HomographyFlow.rotation(1.3 * rotation_vector(scene.R) + 0.002, FIXED)


def stretched(scene: Scene, stretch: np.ndarray | float) -> Scene:
    """Give the smears with their lengths multiplied."""
    middle = scene.ends.mean(axis=1)
    half = 0.5 * (scene.ends[:, 1] - scene.ends[:, 0]) * np.reshape(stretch, (-1, 1))
    return replace(scene, ends=np.stack([middle - half, middle + half], axis=1))


def test_errors_all_over_the_picture_do_not_speak_against_a_rotation() -> None:
    """Lengths 6 % too long on one side, too short on the other: homographies gain much, unless stated."""
    gains = {}
    for shared in (INDEPENDENT, SLOWLY):
        scene = turning(2)
        wrong = stretched(scene, 1 + 0.06 * (scene.ends.mean(axis=1)[:, 0] / 320 - 1))
        likelihood = likelihood_of(wrong, 0.3, shared)
        rotation = fit_homography(likelihood, start(scene))
        near = HomographyFlow.plane(rotation.family.generator().ravel()[:8], FIXED)
        plane = fit_homography(likelihood, near)
        gains[shared] = plane.log_posterior - rotation.log_posterior
    assert gains[INDEPENDENT] > 50
    assert gains[SLOWLY] < 0.15 * gains[INDEPENDENT]


@pytest.mark.slow
def test_regions_hold_the_rotation_where_all_lengths_err_alike() -> None:
    held: list[bool] = []
    without: list[bool] = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        scene = disturb(turning(seed), rng, noise_px=0.2)
        wrong = stretched(scene, 1 + 0.05 * rng.normal())
        plain = likelihood_of(wrong, 0.8)
        fit = fit_homography(plain, start(scene))
        error = fit.family.parameters[:3] - rotation_vector(scene.R)
        for regions, given in ((held, likelihood_of(wrong, 0.8, SLOWLY)), (without, plain)):
            covariance = replace(fit, likelihood=given, slow=np.zeros(SLOW)).covariance()[:3, :3]
            regions.append(bool(error @ np.linalg.solve(covariance, error) < CHI_SQUARED_90[3]))
    assert np.mean(held) > 0.75
    assert np.mean(without) < 0.4


def test_the_distance_to_a_field_is_that_of_both_ends_together() -> None:
    scene = turning(0)
    likelihood = likelihood_of(scene)
    still = HomographyFit(likelihood=likelihood, family=HomographyFlow.plane(np.zeros(8), FIXED))
    apart = scene.ends - scene.ends.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(still.distances_px(likelihood.smears), np.linalg.norm(apart, axis=(1, 2)))
