"""The paper's estimator: its cost, its constraints, Nister's preemption, and what it reaches."""

import numpy as np

from blur2view.arrays import Array
from blur2view.geometry.epipolar import homogeneous
from blur2view.geometry.sampson import serrmin
from blur2view.smears.matches import SmearMatches
from tests.support.scenes import IMAGE_SIZE, make_scene
from tools.estimators.paper import (
    PaperOptions,
    ambiguous_cost,
    constraint_rows,
    minimise_seven,
    paper_of_matches,
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


def test_of_matches_the_same_seed_gives_the_same_bytes_and_too_few_or_still_ones_nothing() -> None:
    options = PaperOptions(max_iterations=5)
    ends = make_scene(np.random.default_rng(6), count=100).ends
    one, two = (paper_of_matches(matches_of(ends), options) for _ in range(2))
    assert one is not None and two is not None and one.tobytes() == two.tobytes()
    few, still = ends[:19], np.random.default_rng(8).uniform(0, 400, (100, 1, 2)).repeat(2, axis=1)
    assert paper_of_matches(matches_of(few), options) is paper_of_matches(matches_of(still), options) is None
