"""The minimal solver on exact samples, and its invariances."""

import numpy as np
import pytest

from blur2view.arrays import Array
from tests.support.scenes import make_scene
from tools.estimators.seven_smears import solve_seven_smears


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
def test_truth_is_among_the_candidates_of_exact_samples() -> None:
    error = []
    for sample, truth in zip(*samples(300), strict=True):
        F = solve_seven_smears(sample[None])
        error.append(min(distance(F, truth).min(), distance(F, truth.T).min()))
    assert max(error) < 1e-3
    assert (np.array(error) < 1e-6).mean() >= 0.99
