"""The study of degeneracy: scenes are what they say, the same for the same seed; the table counts rightly."""

from dataclasses import replace

import numpy as np
import pytest

from blur2view.geometry.epipolar import fundamental_from_pose
from blur2view.geometry.sampson import serrmin
from blur2view.two_view.fit_homography import find_plane
from blur2view.two_view.likelihood import Likelihood
from tools.datasets.degenerate_scenes import KINDS, Kind, draw_scene


@pytest.mark.parametrize("kind", KINDS)
def test_scenes_are_what_they_say_and_the_same_for_the_same_seed(kind: Kind) -> None:
    scene, again, other = draw_scene(kind, 3), draw_scene(kind, 3), draw_scene(kind, 5)
    assert scene.matches.ends.tobytes() == again.matches.ends.tobytes() != other.matches.ends.tobytes()
    assert 1000 <= len(scene.matches) < 2000
    if kind in ("plane", "pure translation", "general"):
        F = fundamental_from_pose(scene.K, scene.R, scene.t)
        assert serrmin(F, scene.true_ends).max() < 1e-12
    if kind in ("pure rotation", "plane", "general"):
        exact = replace(scene.matches, ends=scene.true_ends, sigma_px=np.full(len(scene.true_ends), 0.2))
        likelihood = Likelihood.of(exact)
        plane = find_plane(likelihood, np.zeros(3), [scene.swapped])
        inside = np.mean(np.abs(plane.orders(likelihood).least) < 3)
        assert inside > 0.99 if kind != "general" else inside < 0.9
