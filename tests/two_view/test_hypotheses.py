"""Starts for the robust loop, on exact smears, and the score by which it compares them."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.rotation import half_sphere
from blur2view.geometry.sampson import serrmin
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.constants import CUTOFF
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.ransac import RansacOptions, ransac, weighted_samples
from blur2view.two_view.search import SmearEstimator, meeting_points, small_rotation_hypotheses
from tests.support.scenes import IMAGE_SIZE, Scene, make_scene
from tools.metrics import rho


def rays(scene: Scene) -> Array:
    return scene.camera.rays(scene.ends)


def test_half_sphere_is_even_and_of_unit_length() -> None:
    directions = half_sphere(150)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1)
    assert (directions[:, 2] > 0).all()
    between = directions @ directions.T - 2 * np.eye(150)
    nearest = np.degrees(np.arccos(between.max(axis=1)))
    assert nearest.min() > 6
    assert nearest.max() < 14


def test_three_smears_and_the_true_direction_give_nearly_the_true_F() -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        scene = make_scene(rng, count=200, length_px=8, rotation_share=0.8)
        normalised = rays(scene)
        direction = scene.t[None] / np.linalg.norm(scene.t)
        samples = normalised[rng.integers(0, 200, (20, 3))]
        F = small_rotation_hypotheses(samples, direction, np.full(3, 0.2))
        assert np.abs(np.linalg.det(F)).max() < 1e-12
        assert np.median(rho(F, normalised), axis=1).min() < 0.02


@pytest.mark.parametrize("swapped", [[], [1], [2], [1, 2]])
def test_every_order_of_three_smears_is_tried(swapped: list[int]) -> None:
    scene = make_scene(np.random.default_rng(3), count=60, length_px=8, rotation_share=0.8)
    ends = rays(scene)
    ends[scene.swapped] = ends[scene.swapped][:, ::-1]  # all in the order of time
    direction = scene.t[None] / np.linalg.norm(scene.t)
    best = []
    for sample in ends.reshape(20, 1, 3, 2, 2).copy():
        sample[:, swapped] = sample[:, swapped, ::-1]
        F = small_rotation_hypotheses(sample, direction, np.full(3, 0.2))
        best += [np.median(rho(F, ends), axis=1).min()] if len(F) else []
    assert len(best) > 15 and np.median(best) < 0.01


def test_rotations_beyond_the_limit_are_dropped() -> None:
    scene = make_scene(np.random.default_rng(0), count=30)
    samples = rays(scene).reshape(10, 3, 2, 2)
    everything, some = (
        len(small_rotation_hypotheses(samples, half_sphere(20), np.full(3, limit))) for limit in (1e6, 0.05)
    )
    assert everything == 10 * 20 * 4
    assert 0 < some < everything


def test_dependent_smears_give_no_hypothesis() -> None:
    same = np.broadcast_to(np.array([[0.1, 0.1], [0.12, 0.1]]), (1, 3, 2, 2))
    assert len(small_rotation_hypotheses(same, half_sphere(10), np.ones(3))) == 0


def test_smears_of_a_translation_meet_in_its_epipole() -> None:
    scene = make_scene(np.random.default_rng(1), count=40, rotation_share=0.0)
    points = meeting_points(scene.ends.reshape(20, 2, 2, 2))
    epipole = scene.K @ scene.t
    assert np.median(np.abs(points @ (epipole / np.linalg.norm(epipole)))) > 1 - 1e-9
    assert np.allclose(meeting_points(np.zeros((1, 2, 2, 2))), 0)


def test_samples_do_not_repeat_and_follow_the_weights() -> None:
    weights = np.r_[np.full(10, 1.0), np.full(10, 9.0)]
    drawn = weighted_samples(weights, 7, 500, np.random.default_rng(0))
    assert (np.diff(np.sort(drawn, axis=1), axis=1) > 0).all()
    assert 0.7 < (drawn >= 10).mean() < 0.95
    with pytest.raises(ValueError, match="at least 7"):
        weighted_samples(np.ones(6), 7, 1, np.random.default_rng(0))


def test_score_is_the_cut_sum_of_squared_distances_in_standard_deviations() -> None:
    rng = np.random.default_rng(0)
    ends = make_scene(rng, count=200, length_px=15).ends
    sigma = rng.uniform(0.3, 3, len(ends))
    matches = SmearMatches.from_points(ends[:, 0], ends[:, 1], sigma_px=sigma, image_size=IMAGE_SIZE)
    estimator = SmearEstimator(likelihood=Likelihood.of(matches))
    models, some = rng.normal(size=(20, 3, 3)), rng.permutation(200)[:150]
    squared = np.stack([serrmin(estimator.likelihood.pixels(F), ends) for F in models])
    deviations = squared / matches.sampson_px**2
    expected = np.minimum(deviations, CUTOFF**2)[:, some].sum(axis=1)
    np.testing.assert_allclose(estimator.score(models, some), expected, rtol=1e-3)


def test_a_search_among_smears_as_long_as_their_errors_ends_at_once() -> None:
    ends, sigma = make_scene(np.random.default_rng(0), count=200, length_px=3).ends, np.full(200, 20.0)
    matches = SmearMatches.from_points(ends[:, 0], ends[:, 1], sigma_px=sigma, image_size=IMAGE_SIZE)
    estimator = SmearEstimator(likelihood=Likelihood.of(matches))
    assert ransac(estimator, RansacOptions(), np.random.default_rng(0)).iterations == 16
