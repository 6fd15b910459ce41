"""The rotation alone: exact, among errors that neighbours share, its order in time and its covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from blur2view.camera.camera import Camera
from blur2view.geometry.pose import CHI_SQUARED_90, RigidTransform
from blur2view.geometry.rotation import rotation_vector
from blur2view.geometry.two_view_geometry import Parallax
from blur2view.robust.problem import LENGTH_ERROR, SmearProblem, build_problem
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.rotation_only import RotationFit, rotation_alone
from tests.support.scenes import IMAGE_SIZE, Scene, disturb, make_scene


def turning(rng: np.random.Generator) -> Scene:
    return make_scene(rng, count=1500, length_px=15, rotation_share=np.inf)


def problem_of(scene: Scene, sigma_px: float = 1.0, independent: float = 1.0) -> SmearProblem:
    camera = Camera(K=scene.K, width=IMAGE_SIZE[0], height=IMAGE_SIZE[1])
    problem = build_problem(scene.ends, np.full(len(scene.ends), sigma_px), IMAGE_SIZE, camera)
    return replace(problem, independent=independent * len(scene.ends))


def test_a_pure_rotation_is_found_without_orders() -> None:
    for seed in range(5):
        scene = turning(np.random.default_rng(seed))
        problem, true = problem_of(scene), rotation_vector(scene.R)
        for vector in (rotation_alone(problem), RotationFit(problem=problem).vector):
            assert np.linalg.norm(vector * np.sign(vector @ true) - true) < 0.01 * np.linalg.norm(true)


def test_its_time_is_that_of_the_orders() -> None:
    scene = turning(np.random.default_rng(1))
    fit, true = RotationFit(problem=problem_of(scene)), rotation_vector(scene.R)
    forward, backward = fit.ordered_by(scene.swapped), fit.ordered_by(~scene.swapped)
    assert np.linalg.norm(forward - true) < 0.01 * np.linalg.norm(true)
    np.testing.assert_array_equal(forward, -backward)


def test_a_smear_has_its_length_along_itself_and_nothing_across() -> None:
    problem = problem_of(turning(np.random.default_rng(2)))
    along, across = RotationFit(problem=problem).measured
    sigma_px = np.hypot(2**0.5 * problem.sigma_px, LENGTH_ERROR * problem.length_px)
    np.testing.assert_allclose(along, problem.length_px / sigma_px)
    np.testing.assert_allclose(across, 0, atol=1e-12)


def test_errors_that_neighbours_share_are_in_the_covariance() -> None:
    """The 90 % regions of rotations with a network's errors hold the truth; white noise alone would not."""
    held: dict[float, list[bool]] = {0.03: [], 1.0: []}
    for seed in range(12):
        rng = np.random.default_rng(seed)
        scene = disturb(turning(rng), rng, direction_deg=4.0, length_share=0.1)
        true = RigidTransform(rotation=scene.R, translation=np.zeros(3))
        for independent, inside in held.items():
            problem = problem_of(scene, 0.5 * 0.12 * 15, independent)
            pose, covariance = RotationFit(problem=problem).pose(scene.swapped, translates=False)
            assert not pose.translation.any()
            inside.append(covariance.squared_distance(pose, true, slice(0, 3)) < CHI_SQUARED_90[3])
    assert np.mean(held[0.03]) > 0.75 and np.mean(held[1.0]) < 0.7


def test_the_covariance_is_that_of_the_estimates_where_errors_reach_the_cutoff() -> None:
    """Estimates of one rotation from other errors scatter as stated (Gauss-Newton's weights: 0.7 of it)."""
    scene, estimates, stated = turning(np.random.default_rng(0)), [], []
    true = rotation_vector(scene.R)
    for seed in range(40):
        noise = 0.4 * np.random.default_rng(seed).normal(size=scene.ends.shape)
        fit = RotationFit(problem=problem_of(replace(scene, ends=scene.ends + noise), 0.12))
        estimates.append(fit.vector * np.sign(fit.vector @ true))
        stated.append(np.diag(fit.covariance))
    ratio = np.sqrt(np.mean(stated, axis=0) / np.var(estimates, axis=0))
    assert 0.85 < ratio.mean() < 1.35


def test_a_translation_that_is_not_seen_widens_the_rotation() -> None:
    scene = turning(np.random.default_rng(2))
    fit = RotationFit(problem=problem_of(scene))
    alone, unseen = (fit.pose(scene.swapped, translates)[1] for translates in (False, True))
    assert (unseen.rotation_sigma_deg > 5 * alone.rotation_sigma_deg).all()
    assert 40 < alone.translation_sigma_deg < 46  # any direction


def test_where_parallax_is_open_the_whole_rotation_is_given() -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        scene = disturb(turning(rng), rng, direction_deg=3.0, length_share=0.1)
        matches = SmearMatches(ends=scene.ends, sigma_px=0.3 * scene.length_px, image_size=IMAGE_SIZE)
        camera = Camera(K=scene.K, width=IMAGE_SIZE[0], height=IMAGE_SIZE[1])
        geometry = estimate_two_view(matches, camera=camera)
        pose, true = geometry.cam2_from_cam1, rotation_vector(scene.R)
        assert geometry.parallax is not Parallax.PROVEN
        assert pose is not None and not pose.translation.any() and geometry.covariance is not None
        vector = pose.rotation_vector
        assert np.linalg.norm(vector * np.sign(vector @ true) - true) < 0.15 * np.linalg.norm(true)
        back = geometry.reversed().cam2_from_cam1
        assert back is not None
        np.testing.assert_allclose(back.rotation, pose.rotation.T)
