"""The paper's estimator: its cost, its constraints, Nister's preemption, and what it reaches."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import homogeneous, unit_norm
from blur2view.geometry.sampson import serrmin
from blur2view.smears.matches import SmearMatches
from tests.support.scenes import IMAGE_SIZE, make_scene, with_outliers
from tools.estimators.paper import (
    PaperOptions,
    ambiguous_cost,
    cofactors,
    constraint_rows,
    determinant,
    minimise_seven,
    nearest_rank_two,
    paper_fundamental,
    paper_of_matches,
    preemptive_best,
)


def matches_of(ends: Array) -> SmearMatches:
    return SmearMatches(ends=ends, sigma_px=np.ones(len(ends)), image_size=IMAGE_SIZE)


def test_cost_is_the_sum_of_the_lesser_residuals_of_F_and_its_transpose() -> None:
    rng = np.random.default_rng(0)
    ends, F = rng.normal(size=(7, 2, 2)), rng.normal(size=(3, 3))
    x, y = homogeneous(ends[:, 0]), homogeneous(ends[:, 1])
    forward, backward = (np.einsum("ni,ij,nj->n", y, matrix, x) for matrix in (F, F.T))
    expected = (np.minimum(np.abs(forward), np.abs(backward)) ** 2).sum()
    cost, _ = ambiguous_cost(F.ravel(), *constraint_rows(ends))
    assert np.isclose(cost, expected)


def test_derivatives_agree_with_differences() -> None:
    rng = np.random.default_rng(2)
    rows, f = constraint_rows(rng.normal(size=(7, 2, 2))), rng.normal(size=9)
    for value, gradient in (
        (lambda f: ambiguous_cost(f, *rows)[0], ambiguous_cost(f, *rows)[1]),
        (determinant, cofactors(f)),
    ):
        numeric = [(value(f + step) - value(f - step)) / 2e-6 for step in 1e-6 * np.eye(9)]
        assert np.allclose(gradient, numeric, rtol=1e-5, atol=1e-6)
    assert np.isclose(determinant(f), np.linalg.det(f.reshape(3, 3)))


def test_minimum_has_rank_two_and_mostly_fits_its_sample_but_rarely_is_the_true_F() -> None:
    """Seven smears have some 155 solutions: what the exact solver of all patterns is for."""
    fits, hits = [], []
    for seed in range(20):
        scene = make_scene(np.random.default_rng(seed), count=40)
        F, truth = minimise_seven(scene.ends[:7], np.random.default_rng(seed)), scene.F
        assert F is not None and np.isclose(np.linalg.norm(F), 1) and np.linalg.svd(F)[1][2] < 1e-12
        fits.append(serrmin(F, scene.ends[:7]).max() < 1e-4)
        hits.append(min(np.linalg.norm(F - sign * f) for sign in (1, -1) for f in (truth, truth.T)) < 1e-3)
    assert np.mean(fits) > 0.6 and sum(hits) <= 3


def test_preemption_keeps_the_model_with_most_inliers() -> None:
    rng = np.random.default_rng(3)
    scene = make_scene(rng, count=800)
    wrong = np.stack([nearest_rank_two(rng.normal(size=(3, 3))) for _ in range(200)])
    models = np.insert(wrong, 77, unit_norm(scene.F), axis=0)
    assert (preemptive_best(models, scene.ends) == models[77]).all()
    assert (preemptive_best(models[:1], scene.ends) == models[0]).all()


def test_search_stops_once_enough_fits_or_after_its_iterations() -> None:
    scene = make_scene(np.random.default_rng(5), count=200, length_px=2.0)
    F, drawn = paper_fundamental(scene.ends, PaperOptions(stop_share=0.5), np.random.default_rng(0))
    assert drawn < 1000 and F is not None
    assert (serrmin(F, scene.ends) < 1).mean() >= 0.5
    hard = with_outliers(make_scene(np.random.default_rng(4), count=200), np.random.default_rng(4), 0.6)
    F, drawn = paper_fundamental(hard.ends, PaperOptions(max_iterations=12), np.random.default_rng(0))
    assert drawn == 12 and F is not None


def test_of_matches_the_same_seed_gives_the_same_bytes_and_too_few_or_still_ones_nothing() -> None:
    options = PaperOptions(max_iterations=5)
    ends = make_scene(np.random.default_rng(6), count=100).ends
    one, two = (paper_of_matches(matches_of(ends), options) for _ in range(2))
    assert one is not None and two is not None and one.tobytes() == two.tobytes()
    few, still = ends[:19], np.random.default_rng(8).uniform(0, 400, (100, 1, 2)).repeat(2, axis=1)
    assert paper_of_matches(matches_of(few), options) is paper_of_matches(matches_of(still), options) is None


def test_samples_without_information_are_no_trouble() -> None:
    ends = np.zeros((50, 2, 2))
    F, drawn = paper_fundamental(ends, PaperOptions(max_iterations=3), np.random.default_rng(0))
    assert drawn <= 3
    assert F is None or np.isfinite(F).all()
    with pytest.raises(ValueError, match="at least 7"):
        paper_fundamental(ends[:6], PaperOptions(), np.random.default_rng(0))
