"""Depth orders smears that F leaves open, and tells the sign of a translation."""

from dataclasses import replace

import numpy as np
import pytest

from blur2view import Camera, ExposureViews, RigidTransform, SmearMatches, TwoViewGeometry, estimate_two_view
from blur2view.exposure.end_order import motion_order
from blur2view.exposure.views import other_translation, share_in_front
from tests.exposure.test_time_direction import clip, views
from tests.support.scenes import Scene, disturb, make_scene


def found_in(scene: Scene, camera: Camera | None = None) -> tuple[SmearMatches, TwoViewGeometry]:
    sigma = np.maximum(0.5, 0.12 * scene.length_px)
    matches = scene.matches(sigma)
    return matches, estimate_two_view(matches, rng=np.random.default_rng(0), camera=camera)


def swapped_in(
    scene: Scene, geometry: TwoViewGeometry, matches: SmearMatches, camera: Camera | None = None
) -> np.ndarray:
    order = motion_order(geometry, matches.ends, matches.sampson_px, camera, scene.image_size)
    return order.swapped(matches.ends, matches.sampson_px)


def right_share(swapped: np.ndarray, scene: Scene) -> float:
    """Share of the orders that are right, in the better of both flips of time."""
    return max(float((swapped == scene.swapped).mean()), float((swapped != scene.swapped).mean()))


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, None], ids=["translation", "general"])
def test_depth_orders_what_F_leaves_open(share: float | None) -> None:
    """Eight scenes with 4 degrees of noise that neighbours share."""
    plain, deep = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        scene = make_scene(rng, count=800, rotation_share=share)
        scene = disturb(scene, rng, direction_deg=4, length_share=0.1, noise_px=0.3)
        matches, geometry = found_in(scene)
        swapped = swapped_in(scene, geometry, matches)
        plain.append(right_share(geometry.swapped, scene))
        deep.append(right_share(swapped, scene))
    assert np.median(deep) > 0.98
    assert min(deep) > 0.94
    assert np.median(plain) <= (0.7 if share == 0 else np.median(deep))


def test_pose_without_translation_orders_as_its_rotation_whatever_F_beside_it_says() -> None:
    scene = make_scene(np.random.default_rng(1), count=400, length_px=30, rotation_share=25.0)
    camera = scene.camera
    matches, geometry = found_in(scene, camera)
    assert geometry.F is not None
    for rotation in (scene.R, scene.R.T):
        still = RigidTransform(rotation=rotation, translation=np.zeros(3))
        open_geometry = replace(geometry, cam2_from_cam1=still, covariance=None)
        swapped = swapped_in(scene, open_geometry, matches, camera)
        assert (swapped == (scene.swapped if rotation is scene.R else ~scene.swapped)).mean() > 0.98
        ends = ExposureViews(
            name="a", size=scene.image_size, points_open=scene.ends[:, 0], points_close=scene.ends[:, 1],
            sampson_px=matches.sampson_px, geometry=open_geometry, camera=camera,
        )  # fmt: skip
        assert share_in_front(ends) == 0 and other_translation(ends) is None


def test_other_translation_twice_is_where_it_began() -> None:
    given = views(clip(np.random.default_rng(3)))
    once = other_translation(given)
    assert once is not None
    twice = other_translation(once)
    assert twice is not None and twice.geometry.E is not None and given.geometry.E is not None
    before, after = given.geometry.cam2_from_cam1, once.geometry.cam2_from_cam1
    assert before is not None and after is not None
    np.testing.assert_allclose(after.translation, -before.translation)
    np.testing.assert_array_equal(twice.points_open, given.points_open)
    np.testing.assert_array_equal(twice.geometry.swapped, given.geometry.swapped)
    np.testing.assert_allclose(twice.geometry.E, given.geometry.E)
    moved = (once.points_open != given.points_open).any(axis=1)
    np.testing.assert_array_equal(once.geometry.swapped, given.geometry.swapped ^ moved)
    assert other_translation(replace(given, geometry=replace(given.geometry, F=None, E=None))) is None
