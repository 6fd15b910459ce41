"""Synthetic smears: exact truth, and scenes that are what they say."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from blur2view.geometry.epipolar import sampson, serrmin
from blur2view.two_view.homography import FieldLikelihood, find_plane
from blur2view.two_view.likelihood import NormalisedSmears
from tools.datasets import synthetic_matches as synthetic
from tools.datasets.synthetic_matches import Kind, Motion, Scene, SyntheticOptions, synthetic_smears


@pytest.mark.parametrize("motion", get_args(Motion))
@pytest.mark.parametrize("kind", get_args(Kind))
def test_exact_smears_fit_the_true_F_in_their_true_order(kind: Kind, motion: Motion) -> None:
    options = SyntheticOptions(kind=kind, motion=motion, count=300, outliers=0.0, noise_px=0.0)
    smears = synthetic_smears(0, options)
    assert sampson(smears.F, *np.moveaxis(smears.true_ends, 1, 0)).max() < 1e-9
    np.testing.assert_allclose(smears.ordered, smears.true_ends, atol=1e-9)
    assert synthetic.median_length(smears.matches.ends) == pytest.approx(20, rel=0.01)
    assert 0.3 < smears.swapped.mean() < 0.7


@pytest.mark.parametrize("kind", synthetic.SCENES)
def test_scenes_are_what_they_say_and_the_same_for_the_same_seed(kind: Scene) -> None:
    scene, again, other = (synthetic.draw_scene(kind, seed) for seed in (3, 3, 5))
    assert scene.matches.ends.tobytes() == again.matches.ends.tobytes() != other.matches.ends.tobytes()
    if kind in ("plane", "pure translation", "general"):
        assert serrmin(scene.F, scene.true_ends).max() < 1e-12
    if kind in ("pure rotation", "plane", "general"):
        exact = replace(scene.matches, ends=scene.true_ends, sigma_px=np.full(len(scene.true_ends), 0.2))
        likelihood = NormalisedSmears.of(exact)
        plane = find_plane(FieldLikelihood(smears=likelihood), np.zeros(8), scene.swapped)
        inside = np.mean(plane.distances_px(likelihood) < 3 * likelihood.sigma_px)
        assert inside > 0.99 if kind != "general" else inside < 0.9


def test_a_camera_that_comes_nearer_by_half_sees_twice_as_far_from_the_centre() -> None:
    ends = synthetic.project_smears(
        np.eye(3), np.eye(3), np.array([0, 0, -0.5]), np.array([[1.0, -3]]), np.ones(1)
    )
    np.testing.assert_array_equal(ends, [[[1, -3], [2, -6]]])
