"""The linear sign-free solver: exact on exact smears, blind to order, silent where F is undetermined."""

import numpy as np
import pytest
from scenes import disturb, make_scene, project_smears

from blur2view.epipolar import Array, homogeneous, serrmin, symmetric_skew
from blur2view.sign_free import form_monomials, form_of, sign_free_fundamental, split_form


def distance(F: Array, truth: Array) -> float:
    """Difference of unit matrices up to sign and transposition."""
    return float(min(np.linalg.norm(F - sign * f) for sign in (1, -1) for f in (truth, truth.T)))


def test_form_is_the_product_of_both_orders() -> None:
    rng = np.random.default_rng(0)
    ends, F = rng.normal(size=(50, 2, 2)), rng.normal(size=(3, 3))
    x, y = homogeneous(ends[:, 0]), homogeneous(ends[:, 1])
    product = np.einsum("ni,ij,nj->n", x, F, y) * np.einsum("ni,ij,nj->n", y, F, x)
    assert np.allclose(form_monomials(ends) @ form_of(*symmetric_skew(F)), product)


@pytest.mark.parametrize("scale", [1.0, -2.5])
def test_form_splits_into_S_and_a(scale: float) -> None:
    for seed in range(20):
        S, a = symmetric_skew(np.random.default_rng(seed).normal(size=(3, 3)))
        found_S, found_a = split_form(scale * form_of(S, a))
        root = np.sqrt(abs(scale))
        assert min(np.abs(found_S - sign * root * S).max() for sign in (1, -1)) < 1e-9
        assert min(np.abs(found_a - sign * root * a).max() for sign in (1, -1)) < 1e-9


@pytest.mark.parametrize("count", [20, 200])
def test_exact_smears_give_the_true_F(count: int) -> None:
    for seed in range(30):
        scene = make_scene(np.random.default_rng(seed), count=count)
        F = sign_free_fundamental(scene.ends)
        assert F is not None
        assert np.isclose(np.linalg.norm(F), 1) and np.linalg.svd(F)[1][2] < 1e-12
        assert distance(F, scene.F) < 1e-6


def test_the_order_of_the_ends_does_not_matter() -> None:
    rng = np.random.default_rng(1)
    ends = disturb(make_scene(rng, count=100), rng, noise_px=0.2).ends
    swapped = np.where(rng.random(100)[:, None, None] < 0.5, ends, ends[:, ::-1])
    one, other = sign_free_fundamental(ends), sign_free_fundamental(swapped)
    assert one is not None and other is not None
    assert distance(one, other) < 1e-9


def test_a_pure_translation_leaves_the_form_undetermined() -> None:
    """With a . (x x y) = 0 for all smears, (a . (x x y)) (b . (x x y)) vanishes for every b."""
    scene = make_scene(np.random.default_rng(2), count=100, rotation_share=0.0)
    assert sign_free_fundamental(scene.ends) is None


def test_weights_silence_wrong_smears() -> None:
    rng = np.random.default_rng(3)
    scene = make_scene(rng, count=100)
    ends = np.concatenate([scene.ends, rng.uniform(0, 480, (30, 2, 2))])
    plain, weighted = (
        sign_free_fundamental(ends, weights) for weights in (None, np.r_[np.ones(100), np.full(30, 1e-9)])
    )
    assert plain is not None and weighted is not None
    assert distance(weighted, scene.F) < 1e-4 < distance(plain, scene.F)


def test_little_noise_costs_little() -> None:
    """A tenth of a pixel, 400 smears: a start near the truth, not an estimate."""
    errors = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        scene = disturb(make_scene(rng, count=400, length_px=40.0), rng, noise_px=0.1)
        F = sign_free_fundamental(scene.ends)
        assert F is not None
        errors.append(np.median(np.sqrt(serrmin(F, scene.true_ends)) / scene.length_px))
    assert np.median(errors) < 0.05


def test_a_plane_leaves_F_undetermined() -> None:
    scene = make_scene(np.random.default_rng(4), count=200)
    points = scene.true_ends[:, 0]
    depth = 4.0 / (1 + 0.001 * (points[:, 0] - 320))
    assert sign_free_fundamental(project_smears(scene.K, scene.R, scene.t, points, depth)) is None
    assert sign_free_fundamental(np.ones((50, 2, 2))) is None


def test_too_few_smears_are_refused() -> None:
    with pytest.raises(ValueError, match="20"):
        sign_free_fundamental(np.zeros((19, 2, 2)))
