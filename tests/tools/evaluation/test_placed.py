"""The measure of placed views: exact motions have no error, and a video is where its path says."""

import numpy as np
import pytest

from blur2view.exposure.trajectory import changed, relative_motion
from blur2view.geometry.pose import rotation_matrix
from tools.evaluation import placed
from tools.rendering.video import VideoOptions, sample_exposures

OPTIONS = VideoOptions(rate=10, share=0.5, frames=5)
PATHS = sample_exposures(np.random.default_rng(0), OPTIONS)
POSES = {f"f_{index:03d}.png": path.pose(0.0) for index, path in enumerate(PATHS)}


def test_the_true_ends_have_no_error_in_either_order_and_others_have() -> None:
    path = PATHS[2]
    step = np.array([relative_motion(path.pose(0.0), path.pose(tau)) for tau in (-0.5, 0.5)])
    for one in (step, step[::-1]):
        degrees, depth, px = placed.errors(one, path, OPTIONS)
        assert degrees < 1e-5 and depth < 1e-9
        assert px < 0.1 * placed.errors(0 * step, path, OPTIONS)[2]  # its bend
    turned = relative_motion(
        np.eye(3, 4), rotation_matrix(np.radians([0, 0.2, 0])) @ changed(np.eye(3, 4), step[0])
    )
    assert placed.errors(np.array([turned, step[1]]), path, OPTIONS)[0] == pytest.approx(0.1, rel=1e-3)


def test_interpolation_of_an_even_walk_is_exact_and_views_are_read_by_their_names() -> None:
    turn, move = np.array([0.01, -0.02, 0.005]), np.array([0.1, 0.02, 0.05])

    def pose(time: float) -> np.ndarray:
        R = rotation_matrix(turn * time)
        return np.column_stack([R, -R @ (move * time)])

    poses = {f"f_{index:03d}.png": pose(index) for index in range(6)}
    views = {name: one for name, one in poses.items() if name != "f_005.png"}
    for index, name in enumerate(poses):
        views[f"{name}#open"], views[f"{name}#close"] = pose(index - 0.3), pose(index + 0.3)
    found = placed.placed_steps(views)
    assert list(found) == list(poses)[:5]
    for name, step in placed.interpolated_steps(poses, 0.6).items():
        if name in found:
            np.testing.assert_allclose(step, found[name], atol=1e-12)
    twice = {name: one * [1, 1, 1, 2] for name, one in poses.items()}
    assert placed.scale_of(twice, poses) == pytest.approx(0.5)
