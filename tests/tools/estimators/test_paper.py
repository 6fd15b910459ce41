"""The paper's estimator: its cost, its constraints, Nister's preemption, and what it reaches."""

import numpy as np

from blur2view.arrays import Array
from blur2view.geometry.epipolar import homogeneous
from blur2view.smears.matches import SmearMatches
from tests.support.scenes import IMAGE_SIZE, make_scene
from tools.estimators.paper import ambiguous_cost, constraint_rows, paper_of_matches


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


def test_of_matches_the_same_seed_gives_the_same_bytes_and_too_few_or_still_ones_nothing() -> None:
    ends = make_scene(np.random.default_rng(6), count=100).ends
    one, two = (paper_of_matches(matches_of(ends), max_iterations=5) for _ in range(2))
    assert one is not None and two is not None and one.tobytes() == two.tobytes()
    few, still = ends[:19], np.random.default_rng(8).uniform(0, 400, (100, 1, 2)).repeat(2, axis=1)
    assert (
        paper_of_matches(matches_of(few), max_iterations=5)
        is paper_of_matches(matches_of(still), max_iterations=5)
        is None
    )
