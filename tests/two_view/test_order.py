"""The order of the ends: depth decides what F leaves open, a rotation orders all, and all get one answer."""

from pathlib import Path

import numpy as np
import pytest

from blur2view import RigidTransform, TwoViewGeometry, estimate, estimate_two_view, read_image, views_of
from blur2view.geometry.epipolar import homogeneous, sampson
from blur2view.two_view.order import end_order, in_order, open_and_close
from tests.support.scenes import Scene, disturb, make_scene

MODELS = Path(__file__).resolve().parents[2] / "models"


def right_share(second_end_is_open: np.ndarray, scene: Scene) -> float:
    """Share of the orders that are right, in the better of both flips of time."""
    right = float((second_end_is_open == scene.swapped).mean())
    return max(right, 1 - right)


@pytest.mark.parametrize("name", ["sample", "desk", "sample_mover"])
def test_files_and_views_have_one_order(name: str) -> None:
    image = read_image(MODELS / f"{name}.jpg")
    result = estimate(image[::2, ::2] if name == "desk" else image)  # of 960x720 pixels, smears of 75 px
    matches, geometry = result.matches, result.geometry
    views = views_of(name, result)
    first, last = open_and_close(matches.ends, geometry.second_end_is_open)
    np.testing.assert_array_equal(views.points_open, first)
    np.testing.assert_array_equal(views.points_close, last)
    np.testing.assert_array_equal(views.geometry.second_end_is_open, geometry.second_end_is_open)
    order = end_order(geometry, matches.ends, matches.sampson_px, result.camera, result.grid.size)
    again = order.second_end_is_open(matches.ends, matches.sampson_px)  # as linked keypoints are ordered
    np.testing.assert_array_equal(again, geometry.second_end_is_open)
    reverse = order.second_end_is_open(matches.ends[:, ::-1], matches.sampson_px)
    assert (reverse != again).mean() > 0.99  # exchanging given ends exchanges the answer, but for ties


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, None], ids=["translation", "general"])
def test_depth_orders_what_F_leaves_open(share: float | None) -> None:
    """Eight scenes with 4 degrees of noise that neighbours share, beside F's orders alone.

    In the last three depth misleads where the focal length is not the one that F was fitted with.
    """
    plain, deep = [], []
    for seed in (*range(5), 11, 26, 29):
        rng = np.random.default_rng(seed)
        scene = make_scene(rng, count=800, rotation_share=share)
        scene = disturb(scene, rng, direction_deg=4, length_share=0.1, noise_px=0.3)
        geometry = estimate_two_view(scene.matches(np.maximum(0.5, 0.12 * scene.length_px)))
        assert geometry.F is not None
        one, other = scene.ends[:, 0], scene.ends[:, 1]
        plain.append(right_share(sampson(geometry.F, other, one) < sampson(geometry.F, one, other), scene))
        deep.append(right_share(geometry.second_end_is_open, scene))
    assert np.median(deep) > 0.98
    assert min(deep) > 0.94
    assert np.median(plain) <= (0.75 if share == 0 else np.median(deep))


@pytest.mark.parametrize("reverse", [False, True])
def test_a_rotation_alone_orders_all_and_F_and_H_beside_it_run_its_way(reverse: bool) -> None:
    scene = make_scene(np.random.default_rng(0), rotation_share=3.0)
    R = scene.R.T if reverse else scene.R
    H = scene.K @ scene.R @ np.linalg.inv(scene.K)
    given = TwoViewGeometry(
        F=scene.F,
        H=H / np.linalg.norm(H),
        config="PANORAMIC",  # type: ignore[arg-type]
        inlier_mask=np.ones(len(scene.ends), bool),
        second_end_is_open=np.zeros(len(scene.ends), bool),
        cam2_from_cam1=RigidTransform(rotation=R, translation=np.zeros(3)),
    )
    found = in_order(given, scene.matches(1.0), scene.camera)
    first, last = open_and_close(scene.ends, found.second_end_is_open)
    rotated = homogeneous(first) @ (scene.K @ R @ np.linalg.inv(scene.K)).T
    flow = rotated[:, :2] / rotated[:, 2:] - first
    assert ((flow * (last - first)).sum(axis=1) > 0).mean() > 0.99
    np.testing.assert_array_equal(found.F, scene.F.T if reverse else scene.F)
    assert found.H is not None
    true = np.linalg.inv(H) if reverse else H
    np.testing.assert_allclose(found.H / found.H[2, 2], true / true[2, 2], atol=1e-6)
