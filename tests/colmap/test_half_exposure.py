"""Half of a motion, done twice, is the whole."""

import numpy as np
import pytest

from blur2view.exposure.views import half_fundamental, half_geometry, half_pose
from blur2view.geometry.epipolar import fundamental_from_pose, sampson
from blur2view.geometry.pose import RigidTransform, rotation_matrix
from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry
from tests.support.scenes import IMAGE_SIZE, Scene, make_scene
from tools.datasets.synthetic_matches import project_smears


def middle_and_close(seed: int) -> tuple[Scene, RigidTransform, np.ndarray, np.ndarray]:
    """Make a scene, its motion, and points as seen half-way and at the end of that screw."""
    scene = make_scene(np.random.default_rng(seed), count=300, length_px=20)
    width, height = IMAGE_SIZE
    points = np.random.default_rng(seed + 99).uniform(0, 1, (300, 2)) * np.array([width, height], float)
    depth = np.random.default_rng(seed).uniform(2, 8, 300) * float(np.linalg.norm(scene.t)) * 10
    R = rotation_matrix(0.5 * RigidTransform(rotation=scene.R, translation=np.zeros(3)).rotation_vector)
    t = np.asarray(np.linalg.solve(R + np.eye(3), scene.t), np.float64)
    ends = project_smears(scene.K, R, t, points, depth)
    pose = RigidTransform(rotation=scene.R, translation=scene.t / np.linalg.norm(scene.t))
    return scene, pose, ends[:, 0], ends[:, 1]


@pytest.mark.parametrize("seed", range(5))
def test_F_of_half_the_motion_fits_half_smears(seed: int) -> None:
    scene, pose, middle, close = middle_and_close(seed)
    length = np.median(np.linalg.norm(close - middle, axis=1))
    half = half_fundamental(scene.F, IMAGE_SIZE)
    error = np.sqrt(np.median(sampson(half, middle, close)))
    whole = np.sqrt(np.median(sampson(scene.F, middle, close)))
    assert np.linalg.svd(half)[1][2] < 1e-12
    assert error < 0.02 * length
    assert error < 0.2 * whole
    exact = fundamental_from_pose(scene.K, half_pose(pose).rotation, half_pose(pose).translation)
    assert np.sqrt(sampson(exact, middle, close).max()) < 1e-6


def test_known_intrinsics_halve_exactly() -> None:
    scene, pose, middle, close = middle_and_close(7)
    none = np.zeros(0, bool)
    geometry = TwoViewGeometry(
        F=scene.F, cam2_from_cam1=pose, config=Configuration.CALIBRATED, reason="",
        inlier_mask=none, second_end_is_open=none,
    )  # fmt: skip
    half = half_geometry(geometry, scene.camera, IMAGE_SIZE)
    back = half_geometry(geometry.reversed(), scene.camera, IMAGE_SIZE)
    assert half.F is not None and half.E is not None and back.cam2_from_cam1 is not None
    assert np.sqrt(sampson(half.F, middle, close).max()) < 1e-6
    assert half.cam2_from_cam1 is not None and half.covariance is None
    np.testing.assert_allclose(back.cam2_from_cam1.rotation, half.cam2_from_cam1.rotation.T, atol=1e-12)
    np.testing.assert_allclose(
        back.cam2_from_cam1.translation, half.cam2_from_cam1.inverse().translation, atol=1e-12
    )
