"""The calibrated fit: its derivatives, its prior, and how many smears err as one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from blur2view.camera.camera import Camera
from blur2view.robust.parametrization import CameraF, TranslationF
from blur2view.robust.problem import build_problem
from blur2view.robust.residuals import RefineOptions
from blur2view.two_view.calibrated import POSE, CalibratedFit, fit_calibrated
from tests.support.scenes import IMAGE_SIZE, disturb, make_scene


def fit_of(seed: int, *, noise_px: float = 0.0, direction_deg: float = 0.0) -> CalibratedFit:
    """Return the fit from the truth, of a scene with noise of either kind."""
    rng = np.random.default_rng(seed)
    scene = make_scene(rng, length_px=20)
    scene = disturb(
        scene, rng, noise_px=noise_px, direction_deg=direction_deg, length_share=0.02 * direction_deg
    )
    sigma = np.full(len(scene.ends), max(noise_px, 0.05 * direction_deg, 0.1))
    camera = Camera(K=scene.K, width=IMAGE_SIZE[0], height=IMAGE_SIZE[1])
    problem = build_problem(scene.ends, sigma, IMAGE_SIZE, camera)
    t = scene.t / np.linalg.norm(scene.t)
    start = CameraF(t=t, R=scene.R, spread=problem.prior)
    share = 0.03 if direction_deg else 1.0
    return fit_calibrated(problem, start, TranslationF(epipole=t), RefineOptions(data_weight=share))


def test_gradient_is_that_of_half_the_cost() -> None:
    fit = fit_of(0, noise_px=1.0)
    away = fit.moved(np.array([0.01, -0.02, 1e-3, 2e-3, -1e-3])).reordered()
    normal, gradient = away.normal_equations()
    spans = 1e-2 / np.sqrt(np.diag(normal))
    numeric = [
        (away.moved(s * e).cost - away.moved(-s * e).cost) / (4 * s)
        for s, e in zip(spans, np.eye(POSE), strict=True)
    ]
    np.testing.assert_allclose(numeric * spans, gradient * spans, rtol=1e-3, atol=1e-5)


def test_the_curvature_is_positive_definite_wherever_it_is_asked_for() -> None:
    fit = fit_of(0, noise_px=1.0)
    sigma = 1 / np.sqrt(np.diag(fit.normal_equations()[0]))
    for away in np.diag(50 * sigma):  # the cost bends down along some of these
        assert np.linalg.eigvalsh(fit.moved(away).reordered().curvature())[0] > 0


def test_the_pose_rests() -> None:
    fit = fit_of(1, noise_px=1.0)
    normal, gradient = fit.normal_equations()
    step = np.linalg.solve(normal, gradient)
    assert np.sqrt(step @ normal @ step) < 0.1  # standard deviations
    assert 0.85 < fit.noise.scale < 1.1 and fit.noise.outlier_odds < 0.05


def test_noise_is_found_whatever_was_told() -> None:
    fit = fit_of(2, noise_px=1.0)
    wrong = replace(fit.problem, sigma_px=2 * fit.problem.sigma_px)
    again = fit_calibrated(wrong, fit.point, TranslationF(epipole=fit.point.t), fit.options)
    assert np.isclose(2 * again.noise.scale, fit.noise.scale, rtol=0.05)


def test_smears_that_err_alike_widen_the_covariance() -> None:
    alike = fit_of(4, direction_deg=4.0)
    bare = replace(alike, state=replace(alike.state, options=replace(alike.options, data_weight=1.0)))
    wider = alike.covariance().rotation_sigma_deg / bare.covariance().rotation_sigma_deg
    assert wider.min() > 2
