"""Pose errors of F: none at the truth in either order of time, as much as the pose is wrong elsewhere."""

import numpy as np
import pytest

from blur2view.geometry.epipolar import fundamental_from_pose
from tests.support.scenes import make_scene, rotation
from tools.evaluation.pose_error import pose_auc, pose_error_deg, pose_of


@pytest.mark.parametrize("seed", range(5))
def test_true_F_and_its_transpose_of_any_sign_have_no_error(seed: int) -> None:
    scene = make_scene(np.random.default_rng(seed), count=200)
    for F in (scene.F, -scene.F, 3 * scene.F.T):
        assert pose_error_deg(F, scene.K, scene.R, scene.t, scene.ends) < 1e-4
    pose = pose_of(scene.F, scene.K, np.stack(scene.ordered, axis=1))
    np.testing.assert_allclose(pose.rotation, scene.R, atol=1e-6)
    np.testing.assert_allclose(pose.translation, scene.t / np.linalg.norm(scene.t), atol=1e-6)


def test_error_is_the_larger_of_rotation_and_translation() -> None:
    scene = make_scene(np.random.default_rng(6), count=200)
    axis = np.cross(scene.t, [1.0, 0, 0])
    tilt = rotation(np.radians(7) * axis / np.linalg.norm(axis))
    other = fundamental_from_pose(scene.K, scene.R, tilt @ scene.t)
    assert pose_error_deg(other, scene.K, scene.R, scene.t, scene.ends) == pytest.approx(7, abs=0.01)
    turned = fundamental_from_pose(scene.K, rotation(np.radians([0, 0, 3.0])) @ scene.R, scene.t)
    assert pose_error_deg(turned, scene.K, scene.R, scene.t, scene.ends) == pytest.approx(3, abs=0.01)


def test_auc_is_one_without_errors_zero_beyond_the_bound_and_half_between() -> None:
    assert pose_auc(np.zeros(3), 10) == 1 and pose_auc(np.full(3, 11.0), 10) == 0
    assert pose_auc(np.full(3, 5.0), 10) == pytest.approx(0.5)
    assert pose_auc(np.zeros(0), 10) == 0
