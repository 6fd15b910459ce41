"""Both virtual images of a photograph: the flips of time, half of its motion, features that are moved."""

from dataclasses import replace

import numpy as np
import pytest

from blur2view import estimate_two_view
from blur2view.camera import Camera
from blur2view.exposure.views import (
    ALLOWED_SIGMA_PX,
    MAX_SIGMA_SHARE,
    half_fundamental,
    half_geometry,
    keypoint_views,
    views_of,
)
from blur2view.geometry.configuration import Configuration
from blur2view.geometry.epipolar import sampson
from blur2view.geometry.pose import RigidTransform, rotation_matrix
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.pipeline import Estimate
from blur2view.smears.blur import Blur, BlurKind
from blur2view.smears.camera_motion import blur_of
from blur2view.smears.matches import SelectOptions, select_matches
from tests.support.grids import grid_of
from tests.support.scenes import IMAGE_SIZE, Scene, disturb, make_scene
from tools.datasets.synthetic_matches import layered_depth, project_smears


def estimate_of(scene: Scene) -> Estimate:
    width, height = scene.image_size
    matches = scene.matches(0.3)
    geometry = estimate_two_view(matches, rng=np.random.default_rng(0), camera=scene.camera)
    return Estimate(
        grid=grid_of(np.zeros((-(-height // 32), -(-width // 32), 2)), stride=32, shape=(height, width)),
        blur=Blur(kind=BlurKind.CAMERA_MOVED),
        matches=matches,
        geometry=geometry,
        model_id="none",
        camera=scene.camera,
    )


@pytest.fixture(scope="module")
def result() -> Estimate:
    rng = np.random.default_rng(5)
    return estimate_of(disturb(make_scene(rng, count=400, length_px=25), rng, noise_px=0.1))


def test_both_flips_of_time_are_one_answer(result: Estimate) -> None:
    views = views_of("a.jpg", result)
    flip = views.reversed()
    F, G = views.geometry.F, flip.geometry.F
    assert F is not None and G is not None
    expected = sampson(F, views.points_open, views.points_close)
    np.testing.assert_allclose(sampson(G, flip.points_open, flip.points_close), expected, rtol=1e-6)
    np.testing.assert_array_equal(flip.geometry.second_end_is_open, ~views.geometry.second_end_is_open)
    pose, back = views.geometry.cam2_from_cam1, flip.geometry.cam2_from_cam1
    E = flip.geometry.E
    assert pose is not None and back is not None and E is not None
    np.testing.assert_allclose(back.rotation @ pose.rotation, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(back.rotation @ pose.translation, -back.translation, atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(E * back.essential)) / np.sum(E**2), 1, atol=1e-9)
    again = flip.reversed()
    np.testing.assert_array_equal(again.points_open, views.points_open)
    np.testing.assert_allclose(again.geometry.cam2_from_cam1.rotation, pose.rotation, atol=1e-15)  # type: ignore[union-attr]


def middle_and_close(seed: int) -> tuple[Scene, np.ndarray, np.ndarray]:
    """Make a scene, and points as seen half-way and at the end of its screw."""
    scene, rng = make_scene(np.random.default_rng(seed), count=300, length_px=20), np.random.default_rng(seed)
    depth = rng.uniform(2, 8, 300) * float(np.linalg.norm(scene.t)) * 10
    R = rotation_matrix(0.5 * RigidTransform(rotation=scene.R, translation=np.zeros(3)).rotation_vector)
    t = np.asarray(np.linalg.solve(R + np.eye(3), scene.t), np.float64)
    ends = project_smears(scene.K, R, t, rng.uniform(0, IMAGE_SIZE, (300, 2)), depth)
    return scene, ends[:, 0], ends[:, 1]


@pytest.mark.parametrize("seed", range(5))
def test_F_of_half_the_motion_fits_half_smears(seed: int) -> None:
    scene, middle, close = middle_and_close(seed)
    half = half_fundamental(scene.F, IMAGE_SIZE)
    error, whole = (np.sqrt(np.median(sampson(F, middle, close))) for F in (half, scene.F))
    assert np.linalg.svd(half)[1][2] < 1e-12
    assert error < 0.02 * np.median(np.linalg.norm(close - middle, axis=1)) and error < 0.2 * whole


def test_known_intrinsics_halve_exactly() -> None:
    scene, middle, close = middle_and_close(7)
    pose = RigidTransform(rotation=scene.R, translation=scene.t / np.linalg.norm(scene.t))
    none, config = np.zeros(0, bool), Configuration.CALIBRATED
    geometry = TwoViewGeometry(
        F=scene.F, cam2_from_cam1=pose, config=config, inlier_mask=none, second_end_is_open=none
    )
    half, back = (half_geometry(one, scene.camera, IMAGE_SIZE) for one in (geometry, geometry.reversed()))
    assert half.F is not None and half.covariance is None
    assert np.sqrt(sampson(half.F, middle, close).max()) < 1e-6
    assert half.cam2_from_cam1 is not None and back.cam2_from_cam1 is not None
    inverse = half.cam2_from_cam1.inverse()
    np.testing.assert_allclose(back.cam2_from_cam1.rotation, inverse.rotation, atol=1e-12)
    np.testing.assert_allclose(back.cam2_from_cam1.translation, inverse.translation, atol=1e-12)


SIZE = (160, 120)
Result = tuple[Estimate, np.ndarray]


@pytest.fixture(scope="module")
def linked() -> Result:
    """Give an estimate from an exact field, and every pixel's true smear (H, W, 2)."""
    scene = make_scene(np.random.default_rng(3), count=2000, length_px=20, rotation_share=0.5)
    width, height = SIZE
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    points = np.asarray(
        4 * np.stack([x, y], axis=-1).reshape(-1, 2) + 1.5, np.float64
    )  # the scene's picture is 640x480
    depth = layered_depth(np.random.default_rng(1), points) * float(np.linalg.norm(scene.t)) * 4
    K = np.diag([0.25, 0.25, 1.0]) @ scene.K
    K[:2, 2] -= 0.375  # a quarter of the size: pixel j is 4 j + 1.5
    ends = project_smears(K, scene.R, scene.t, (points - 1.5) / 4, depth)
    displacement = (ends[:, 1] - ends[:, 0]).reshape(height, width, 2)
    sign = np.where(np.random.default_rng(0).random((height, width, 1)) < 0.5, -1, 1)
    grid = grid_of(sign * displacement)
    matches = select_matches(grid, SelectOptions(beta=1.0))
    camera = Camera(K=K, width=width, height=height)
    geometry = estimate_two_view(matches, rng=np.random.default_rng(0), camera=camera)
    assert geometry.cam2_from_cam1 is not None
    estimate = Estimate(
        grid=grid, blur=blur_of(grid), matches=matches, geometry=geometry, model_id="", camera=camera
    )
    return estimate, displacement


def test_features_move_by_half_of_their_smear(linked: Result) -> None:
    estimate, displacement = linked
    keypoints = np.random.default_rng(5).integers(5, 100, (200, 2)).astype(float)
    views = keypoint_views("a.jpg", keypoints, estimate)
    assert views.usable is not None
    np.testing.assert_allclose((views.points_open + views.points_close) / 2, keypoints, atol=1e-9)
    cols, rows = keypoints.astype(int).T
    d = views.points_close - views.points_open
    agree = (d * displacement[rows, cols]).sum(axis=1) > 0
    np.testing.assert_allclose(np.abs(d), np.abs(displacement[rows, cols]), atol=1e-4)
    assert max(agree.mean(), 1 - agree.mean()) > 0.97  # one time direction for all, by F and cheirality
    assert views.usable.mean() > 0.9
    assert views.names == ("a.jpg#open", "a.jpg#close") and views.size == SIZE
    F = views.geometry.F
    assert F is not None
    inliers = views.geometry.inlier_mask
    assert inliers.sum() > 150
    assert np.median(sampson(F, views.points_open, views.points_close)[inliers]) < 0.05


@pytest.mark.parametrize("kind", [BlurKind.SHARP, BlurKind.OUT_OF_FOCUS, BlurKind.CAMERA_AT_REST])
def test_features_stay_where_the_camera_did_not_move(linked: Result, kind: BlurKind) -> None:
    estimate, _ = linked
    keypoints = np.array([[50.0, 30.0], [50.0, 90.0]])
    views = keypoint_views("a.jpg", keypoints, replace(estimate, blur=replace(estimate.blur, kind=kind)))
    np.testing.assert_array_equal(views.points_open, keypoints)
    np.testing.assert_array_equal(views.points_close, keypoints)


def test_only_certain_smears_are_used(linked: Result) -> None:
    estimate, _ = linked
    smears = estimate.grid.smears()
    sigma, length = smears.sigma_px.copy(), smears.length_px
    sigma[:60] = np.maximum(MAX_SIGMA_SHARE * length[:60], ALLOWED_SIGMA_PX) + 0.1
    estimate = replace(estimate, grid=grid_of(smears.displacement, sigma))
    keypoints = np.array([[50.0, 30.0], [50.0, 90.0]])
    views = keypoint_views("a.jpg", keypoints, estimate)
    assert views.usable is not None and views.usable.tolist() == [False, True]
    assert not views.geometry.inlier_mask[0]
