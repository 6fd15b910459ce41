"""The minimal solver on exact samples, and its invariances."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.geometry.epipolar import denormalise
from tests.support.scenes import make_scene
from tools.estimators.seven_smears import homogeneous_cubic_roots, solve_seven_smears


def samples(count: int, seed: int = 0) -> tuple[Array, Array]:
    """Give samples (count, 7, 2, 2) of exact smears, and the true F of each."""
    rng = np.random.default_rng(seed)
    scenes = [make_scene(rng, count=60, length_px=rng.uniform(4, 60)) for _ in range(count)]
    ends = np.stack([scene.ends[rng.choice(60, 7, replace=False)] for scene in scenes])
    return ends, np.stack([scene.F for scene in scenes])


def distance(F: Array, truth: Array) -> Array:
    """Relative difference of unit matrices (..., 3, 3) up to sign."""
    both = np.linalg.norm(F - truth, axis=(-2, -1)), np.linalg.norm(F + truth, axis=(-2, -1))
    least: Array = np.minimum(*both)
    return least


@pytest.mark.slow
def test_truth_is_among_the_candidates_of_1000_exact_samples() -> None:
    error = []
    for sample, truth in zip(*samples(1000), strict=True):
        F = solve_seven_smears(sample[None])
        error.append(min(distance(F, truth).min(), distance(F, truth.T).min()))
    assert max(error) < 1e-3
    assert (np.array(error) < 1e-6).mean() >= 0.999


def test_many_samples_give_what_each_gives() -> None:
    ends, _ = samples(3)
    together = solve_seven_smears(ends)
    alone = np.concatenate([solve_seven_smears(sample[None]) for sample in ends])
    assert np.allclose(sorted(np.abs(together).sum(axis=(1, 2))), sorted(np.abs(alone).sum(axis=(1, 2))))


def test_candidates_have_rank_two_and_fit_their_sample() -> None:
    ends = samples(1, seed=2)[0][0]
    F = solve_seven_smears(ends[None])
    singular = np.linalg.svd(F)[1]
    assert np.median(singular[:, 2] / singular[:, 1]) < 1e-9
    x, y = (np.column_stack([ends[:, i], np.ones(7)]) for i in (0, 1))
    forward, backward = (np.abs(np.einsum("ni,mij,nj->mn", *triple)) for triple in ((y, F, x), (x, F, y)))
    scale = np.linalg.norm(x, axis=-1) * np.linalg.norm(y, axis=-1)
    assert np.median((np.minimum(forward, backward) / scale).max(axis=1)) < 1e-12
    assert 100 < len(F) < 192


def same_sets(one: Array, other: Array) -> bool:
    """Whether 97 % of each set are, up to sign and transposition, close to one of the other."""
    pairs = np.minimum(
        distance(one[:, None], other[None]), distance(one[:, None], np.swapaxes(other, 1, 2)[None])
    )
    return bool((pairs.min(0) < 1e-6).mean() > 0.97 and (pairs.min(1) < 1e-6).mean() > 0.97)


def test_swapping_the_ends_of_any_smear_leaves_the_candidates() -> None:
    ends, _ = samples(1, seed=3)
    reference = solve_seven_smears(ends)
    for swap in ([0], [3], [1, 4, 6], range(7)):
        swapped = ends.copy()
        swapped[:, list(swap)] = swapped[:, list(swap), ::-1]
        assert same_sets(solve_seven_smears(swapped), reference)


def test_candidates_follow_a_similarity_of_the_coordinates() -> None:
    ends, _ = samples(1, seed=5)
    T = np.array([[0.02, 0, -5.0], [0, 0.02, 4.0], [0, 0, 1]])
    moved = solve_seven_smears(ends * 0.02 + [-5.0, 4.0])
    assert same_sets(denormalise(moved, T), solve_seven_smears(ends))


def test_samples_without_information_give_no_candidate() -> None:
    same = np.ones((1, 7, 2, 2))
    still = np.random.default_rng(7).uniform(0, 500, (1, 7, 1, 2)).repeat(2, axis=2)
    for ends in (same, still):
        assert solve_seven_smears(ends).shape == (0, 3, 3)


def test_wrong_shapes_are_refused_with_the_shape() -> None:
    with pytest.raises(ValueError, match=r"\(2, 6, 2, 2\)"):
        solve_seven_smears(np.zeros((2, 6, 2, 2)))


@pytest.mark.parametrize("roots", [(1.0, 2.0, 3.0), (-5.0, 1e-3, 2.0), (2.0, 2.0, -1.0), (1e4, 1.0, -1e-4)])
def test_cubic_finds_known_roots(roots: tuple[float, ...]) -> None:
    coefficients = np.asarray(np.poly(roots), float)[:, None]
    alpha, beta = homogeneous_cubic_roots(coefficients)
    assert np.allclose(np.sort((alpha / beta)[:, 0]), np.sort(roots), rtol=1e-6)


def test_cubic_finds_roots_at_infinity_and_leaves_complex_ones_out() -> None:
    alpha, beta = homogeneous_cubic_roots(np.array([[0.0], [0], [1], [-2]]))  # beta^2 (alpha - 2 beta)
    ratio = (beta / alpha)[:, 0]
    assert np.allclose(np.sort(ratio[np.isfinite(ratio)])[[0, -1]], [0, 0.5], atol=1e-4)
    alpha, _ = homogeneous_cubic_roots(np.array([[1.0], [0], [1], [0]]))  # alpha (alpha^2 + beta^2)
    assert np.isfinite(alpha).sum() == 1
    assert np.isnan(homogeneous_cubic_roots(np.zeros((4, 1)))[0]).all()
