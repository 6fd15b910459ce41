"""Both virtual images of a photograph, and the two flips of time."""

import numpy as np
import pytest

from blur2view import estimate_two_view
from blur2view.exposure.views import views_of
from blur2view.geometry.epipolar import sampson
from blur2view.pipeline import Estimate
from blur2view.smears.blur import Blur, BlurKind
from tests.support.grids import grid_of
from tests.support.scenes import Scene, disturb, make_scene


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
