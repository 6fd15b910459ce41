"""Starts for the robust loop, on exact smears, and the score by which it compares them."""

import numpy as np

from blur2view.arrays import Array
from blur2view.geometry.rotation import half_sphere
from blur2view.two_view.fundamental import small_rotation_hypotheses
from tests.support.scenes import Scene, make_scene
from tools.metrics import rho


def rays(scene: Scene) -> Array:
    return scene.camera.rays(scene.ends)


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


def test_dependent_smears_give_no_hypothesis() -> None:
    same = np.broadcast_to(np.array([[0.1, 0.1], [0.12, 0.1]]), (1, 3, 2, 2))
    assert len(small_rotation_hypotheses(same, half_sphere(10), np.ones(3))) == 0
