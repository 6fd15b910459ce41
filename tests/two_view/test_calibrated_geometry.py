"""Known intrinsics through the public door: E and the pose of exact smears, and who gets none."""

import numpy as np
import pytest

from blur2view import Camera, Configuration, SmearMatches, TwoViewGeometry, estimate_two_view
from blur2view.arrays import Array
from blur2view.geometry.epipolar import homogeneous, transfer
from blur2view.geometry.pose import RigidTransform
from blur2view.geometry.sampson import serrmin
from blur2view.two_view.pose import in_order_of_rotation
from tests.support.scenes import IMAGE_SIZE, Scene, disturb, make_scene, with_outliers
from tools.metrics import rotation_error, translation_direction_error_deg


def camera_of(scene: Scene) -> Camera:
    return Camera(K=scene.K, width=IMAGE_SIZE[0], height=IMAGE_SIZE[1])


def solve(scene: Scene, sigma_px: float = 0.05) -> TwoViewGeometry:
    sigma = np.full(len(scene.ends), sigma_px)
    matches = SmearMatches(ends=scene.ends, sigma_px=sigma, image_size=IMAGE_SIZE)
    return estimate_two_view(matches, camera=camera_of(scene))


def errors(geometry: TwoViewGeometry, scene: Scene) -> tuple[float, float]:
    """Give the errors of rotation and translation in degrees, of the better flip of time."""
    pose = geometry.cam2_from_cam1
    assert pose is not None
    flips = [pose, pose.inverse()]
    both = [
        (
            rotation_error(flip.rotation @ scene.R.T, np.eye(3))[0],
            translation_direction_error_deg(flip.translation, scene.t),
        )
        for flip in flips
    ]
    return min(both)


@pytest.mark.parametrize("seed", range(4))
def test_exact_smears_give_the_true_pose_and_all_orders(seed: int) -> None:
    scene = make_scene(np.random.default_rng(seed), length_px=20)
    geometry = solve(scene)
    assert geometry.config is Configuration.CALIBRATED
    turned, moved = errors(geometry, scene)
    assert turned < 0.01
    assert moved < 0.2
    right = (geometry.swapped == scene.swapped).mean()
    assert max(right, 1 - right) > 0.99


def test_E_F_and_the_pose_agree() -> None:
    scene = make_scene(np.random.default_rng(5), length_px=20)
    geometry = solve(scene)
    assert geometry.E is not None and geometry.F is not None and geometry.cam2_from_cam1 is not None
    assert np.allclose(geometry.E, geometry.cam2_from_cam1.essential)
    inverse = np.linalg.inv(scene.K)
    F = inverse.T @ geometry.E @ inverse
    assert np.allclose(geometry.F, F / np.linalg.norm(F), atol=1e-9)
    assert np.median(serrmin(geometry.F, scene.true_ends)) < 1e-4


@pytest.mark.slow
def test_outliers_and_noise_leave_a_pose_within_its_standard_deviations() -> None:
    worst = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene = with_outliers(disturb(make_scene(rng, length_px=25), rng, noise_px=0.5), rng, 0.3)
        geometry = solve(scene, 1.0)
        assert geometry.covariance is not None
        turned, moved = errors(geometry, scene)
        sigma = max(geometry.covariance.rotation_sigma_deg), geometry.covariance.translation_sigma_deg
        worst.append([turned / sigma[0], moved / sigma[1]])
    assert np.median(worst) < 2
    assert np.max(worst) < 6


def test_a_pure_rotation_gives_the_rotation_and_no_translation() -> None:
    scene = make_scene(np.random.default_rng(1), length_px=20, rotation_share=np.inf)
    geometry = solve(disturb(scene, np.random.default_rng(1), noise_px=0.2), 0.4)
    assert geometry.F is None and geometry.E is None
    assert geometry.config is Configuration.PANORAMIC
    pose = geometry.cam2_from_cam1
    assert pose is not None
    assert not pose.translation.any()
    errors_deg = [rotation_error(flip.rotation @ scene.R.T, np.eye(3))[0] for flip in (pose, pose.inverse())]
    assert min(errors_deg) < 0.02


def test_a_refused_photograph_has_no_pose() -> None:
    scene = make_scene(np.random.default_rng(1), count=12)
    geometry = solve(scene)
    assert geometry.config is Configuration.DEGENERATE
    assert geometry.cam2_from_cam1 is None and geometry.E is None and geometry.covariance is None


@pytest.mark.parametrize("rotation_share", [np.inf, 12.0])
def test_smears_of_a_rotation_and_H_run_the_way_of_the_pose(rotation_share: float) -> None:
    rotations = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene = make_scene(rng, count=300, length_px=12, rotation_share=rotation_share)
        scene = disturb(scene, rng, direction_deg=2.0, length_share=0.05)
        geometry = solve(scene, 0.5)
        pose, inliers = geometry.cam2_from_cam1, geometry.inlier_mask
        if pose is None or pose.translation.any():
            continue
        assert geometry.H is not None
        ends = np.where(geometry.swapped[:, None, None], scene.ends[:, ::-1], scene.ends)[inliers]
        assert (along(pose, scene.K, ends) > 0).all()
        first, last = ends.swapaxes(0, 1)
        assert (transfer(geometry.H, first, last) < transfer(geometry.H, last, first)).all()
        rotations += 1
    assert rotations >= 2


def along(pose: RigidTransform, K: Array, ends: Array) -> Array:
    """Return how far (N,) smears from ends[:, 0] to ends[:, 1] lead along the flow of a pose's rotation."""
    first, last = homogeneous(ends).swapaxes(0, 1)
    rotated = first @ (K @ pose.rotation @ np.linalg.inv(K)).T
    flow = rotated[:, :2] / rotated[:, 2:] - first[:, :2]
    return np.asarray((flow * (last - first)[:, :2]).sum(axis=1), float)


@pytest.mark.parametrize("reverse", [False, True])
def test_F_beside_a_rotation_is_brought_into_its_order(reverse: bool) -> None:
    scene = make_scene(np.random.default_rng(0), rotation_share=3.0)
    pose = RigidTransform(rotation=scene.R.T if reverse else scene.R, translation=np.zeros(3))
    none = np.zeros(len(scene.ends), bool)
    given = TwoViewGeometry(
        F=scene.F,
        cam2_from_cam1=pose,
        config=Configuration.PANORAMIC,
        reason="",
        inlier_mask=~none,
        swapped=none,
    )
    matches = SmearMatches(ends=scene.ends, sigma_px=np.ones(len(none)))
    found = in_order_of_rotation(given, matches, camera_of(scene).rays(scene.ends))
    np.testing.assert_array_equal(found.F, scene.F.T if reverse else scene.F)
    ordered = np.where(found.swapped[:, None, None], scene.ends[:, ::-1], scene.ends)
    assert (along(pose, scene.K, ordered) > 0).mean() > 0.99
