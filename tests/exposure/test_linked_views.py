"""Features moved to both ends of the exposure."""

from dataclasses import replace

import numpy as np
import pytest

from blur2view import estimate_two_view
from blur2view.camera import Camera
from blur2view.exposure.views import MAX_SIGMA_SHARE, STILL_PX, keypoint_views
from blur2view.geometry.epipolar import sampson
from blur2view.pipeline import Estimate
from blur2view.smears.blur import BlurKind, blur_of
from blur2view.smears.matches import SelectOptions, select_matches
from tests.support.grids import grid_of
from tests.support.scenes import make_scene
from tools.datasets.synthetic_matches import layered_depth, project_smears

SIZE = (160, 120)
Result = tuple[Estimate, np.ndarray]


@pytest.fixture(scope="module")
def result() -> Result:
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


def test_features_move_by_half_of_their_smear(result: Result) -> None:
    estimate, displacement = result
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
def test_features_stay_where_the_camera_did_not_move(result: Result, kind: BlurKind) -> None:
    estimate, _ = result
    keypoints = np.array([[50.0, 30.0], [50.0, 90.0]])
    views = keypoint_views("a.jpg", keypoints, replace(estimate, blur=replace(estimate.blur, kind=kind)))
    np.testing.assert_array_equal(views.points_open, keypoints)
    np.testing.assert_array_equal(views.points_close, keypoints)


def test_only_certain_smears_are_used(result: Result) -> None:
    estimate, _ = result
    smears = estimate.grid.smears()
    sigma, length = smears.sigma_px.copy(), smears.length_px
    sigma[:60] = np.maximum(MAX_SIGMA_SHARE * length[:60], STILL_PX) + 0.1
    estimate = replace(estimate, grid=grid_of(smears.displacement, sigma))
    keypoints = np.array([[50.0, 30.0], [50.0, 90.0]])
    linked = keypoint_views("a.jpg", keypoints, estimate)
    assert linked.usable is not None and linked.usable.tolist() == [False, True]
    assert not linked.geometry.inlier_mask[0]
