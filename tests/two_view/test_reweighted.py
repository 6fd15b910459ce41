"""Reweighted least squares: outliers, unknown signs, a prior, many problems at once."""

import numpy as np

from blur2view.arrays import Array
from blur2view.two_view.least_squares import reweighted_motion

MOTION = np.array([0.3, -1.2, 0.7])


def flows(seed: int, outliers: float = 0.3) -> tuple[Array, Array]:
    """Return rows (3, 2, N) and the flow (2, N) of MOTION, a share of it replaced."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(3, 2, 200))
    flow = np.einsum("k,kdn->dn", MOTION, rows)
    wrong = rng.random(200) < outliers
    flow[:, wrong] = 3 * rng.normal(size=(2, int(wrong.sum())))
    return rows, flow


def by_median(missed: Array) -> Array:
    return np.asarray(np.median(missed, axis=-1, keepdims=True) + 1e-9)


def test_outliers_do_not_move_it() -> None:
    rows, flow = flows(0)
    plain = np.linalg.lstsq(rows.reshape(3, -1).T, flow.ravel(), rcond=None)[0]
    motion, missed = reweighted_motion(rows, flow, steps=20, scale=by_median)
    assert np.abs(motion - MOTION).max() < 1e-6 < np.abs(plain - MOTION).max()
    assert np.isclose(np.median(missed), 0, atol=1e-6)


def test_a_sure_prior_wins_and_a_vague_one_does_not() -> None:
    rows, flow = flows(2)
    for precision, expected in ((1e12, np.zeros(3)), (1e-12, MOTION)):
        prior = np.zeros(3), np.full(3, precision)
        motion, _ = reweighted_motion(rows, flow, steps=20, scale=lambda _: 0.01, prior=prior)
        assert np.abs(motion - expected).max() < 1e-3


def test_problems_on_leading_axes_are_solved_by_themselves() -> None:
    pairs = [flows(seed) for seed in range(4)]
    rows, flow = (np.stack(arrays) for arrays in zip(*pairs, strict=True))
    together, _ = reweighted_motion(rows, flow, steps=5, scale=by_median)
    alone = [reweighted_motion(*pair, steps=5, scale=by_median)[0] for pair in pairs]
    assert np.allclose(together, alone)
