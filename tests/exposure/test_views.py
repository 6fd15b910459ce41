"""Both virtual images of a photograph: the two flips of time, and half of its motion."""

import numpy as np
import pytest

from blur2view import estimate_two_view
from blur2view.exposure.views import half_fundamental, half_geometry, views_of
from blur2view.geometry.epipolar import sampson
from blur2view.geometry.pose import RigidTransform, rotation_matrix
from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry
from blur2view.pipeline import Estimate
from blur2view.smears.blur import Blur, BlurKind
from tests.support.grids import grid_of
from tests.support.scenes import IMAGE_SIZE, Scene, disturb, make_scene
from tools.datasets.synthetic_matches import project_smears


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
        F=scene.F, cam2_from_cam1=pose, config=config, reason="", inlier_mask=none, second_end_is_open=none
    )
    half, back = (half_geometry(one, scene.camera, IMAGE_SIZE) for one in (geometry, geometry.reversed()))
    assert half.F is not None and half.covariance is None
    assert np.sqrt(sampson(half.F, middle, close).max()) < 1e-6
    assert half.cam2_from_cam1 is not None and back.cam2_from_cam1 is not None
    inverse = half.cam2_from_cam1.inverse()
    np.testing.assert_allclose(back.cam2_from_cam1.rotation, inverse.rotation, atol=1e-12)
    np.testing.assert_allclose(back.cam2_from_cam1.translation, inverse.translation, atol=1e-12)
