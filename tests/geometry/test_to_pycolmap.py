"""Our two-view geometry as pycolmap's: it finds the same from the same points, and its database keeps it."""

from dataclasses import replace

import numpy as np
import pycolmap
import pytest

from blur2view.camera.camera import to_colmap
from blur2view.geometry.two_view_geometry import (
    Configuration,
    TwoViewGeometry,
    fundamental_to_colmap,
    homography_to_colmap,
)
from blur2view.two_view.estimate import estimate_two_view
from tests.support.scenes import IMAGE_SIZE, Scene, make_scene
from tools.metrics import translation_direction_error_deg

COUNT = 400


def solved(seed: int = 0) -> tuple[Scene, TwoViewGeometry]:
    scene = make_scene(np.random.default_rng(seed), count=COUNT, length_px=30.0, rotation_share=0.5)
    return scene, estimate_two_view(scene.matches(0.1), camera=scene.camera)


def ordered(scene: Scene, geometry: TwoViewGeometry) -> tuple[np.ndarray, np.ndarray]:
    """COLMAP's pixels of the open and of the close ends, as the geometry orders them."""
    index, swapped = np.arange(COUNT), geometry.second_end_is_open.astype(int)
    return to_colmap(scene.ends[index, swapped]), to_colmap(scene.ends[index, 1 - swapped])


def pinhole(scene: Scene) -> pycolmap.Camera:
    params = [scene.K[0, 0], scene.K[1, 1], *to_colmap(scene.K[:2, 2])]
    return pycolmap.Camera(model="PINHOLE", width=IMAGE_SIZE[0], height=IMAGE_SIZE[1], params=params)


def test_pycolmap_estimates_the_same_from_the_same_points() -> None:
    scene, geometry = solved()
    ours = geometry.to_pycolmap()
    assert ours.config == pycolmap.TwoViewGeometryConfiguration.CALIBRATED and ours.cam2_from_cam1 is not None
    points1, points2 = ordered(scene, geometry)
    camera, matches = pinhole(scene), np.arange(COUNT, dtype=np.uint32)[:, None].repeat(2, axis=1)
    theirs = pycolmap.estimate_calibrated_two_view_geometry(camera, points1, camera, points2, matches)
    pycolmap.estimate_two_view_geometry_pose(camera, points1, camera, points2, theirs)
    assert theirs.cam2_from_cam1 is not None
    turn = ours.cam2_from_cam1.rotation.inverse() * theirs.cam2_from_cam1.rotation
    assert np.degrees(turn.angle()) < 0.02
    direction = theirs.cam2_from_cam1.translation
    assert ours.cam2_from_cam1.translation @ direction > 0
    assert translation_direction_error_deg(ours.cam2_from_cam1.translation, direction) < 1
    np.testing.assert_allclose(ours.E, pycolmap.essential_matrix_from_pose(ours.cam2_from_cam1), atol=1e-9)


def test_fundamental_holds_for_colmaps_pixels_and_not_for_ours() -> None:
    scene, geometry = solved()
    points1, points2 = (np.c_[points, np.ones(COUNT)] for points in ordered(scene, geometry))
    F = geometry.to_pycolmap().F
    line = points1 @ F.T
    distance = np.abs((points2 * line).sum(1)) / np.hypot(*line[:, :2].T)
    assert np.median(distance) < 0.02
    assert np.linalg.norm(F) == pytest.approx(1)


def test_half_a_pixel_moves_f_and_h_as_it_moves_points() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 100, (20, 2))
    H = np.eye(3) + 1e-3 * rng.normal(size=(3, 3))
    there = np.c_[points, np.ones(20)] @ H.T
    expected = there[:, :2] / there[:, 2:] + 0.5
    moved = np.c_[points + 0.5, np.ones(20)] @ homography_to_colmap(H).T
    np.testing.assert_allclose(moved[:, :2] / moved[:, 2:], expected, atol=1e-9)
    F = rng.normal(size=(3, 3))
    x, y = (np.c_[rng.uniform(0, 100, (20, 2)), np.ones(20)] for _ in range(2))
    before = np.einsum("ni,ij,nj->n", y, F, x)
    half = np.array([0.5, 0.5, 0])
    after = np.einsum("ni,ij,nj->n", y + half, fundamental_to_colmap(F), x + half)
    np.testing.assert_allclose(after * (before[0] / after[0]), before, rtol=1e-9)


@pytest.mark.parametrize("config", Configuration)
def test_every_configuration_has_its_namesake(config: Configuration) -> None:
    none = np.zeros(5, bool)
    geometry = TwoViewGeometry(F=None, config=config, reason="", inlier_mask=none, second_end_is_open=none)
    theirs = geometry.to_pycolmap()
    assert pycolmap.TwoViewGeometryConfiguration(theirs.config).name == config.name
    assert theirs.F is None and theirs.E is None and theirs.cam2_from_cam1 is None
    assert theirs.inlier_matches.shape == (0, 2)


def test_reversed_time_is_pycolmaps_inverse() -> None:
    _, geometry = solved()
    theirs = geometry.to_pycolmap()
    theirs.invert()
    ours = geometry.reversed().to_pycolmap()
    for name in ("F", "E"):
        first, second = getattr(ours, name), getattr(theirs, name)
        np.testing.assert_allclose(first * np.sign((first * second).sum()), second, atol=1e-9)
    np.testing.assert_allclose(ours.cam2_from_cam1.matrix(), theirs.cam2_from_cam1.matrix(), atol=1e-9)


def test_E_of_another_motion_than_the_pose_is_left_out() -> None:
    _, geometry = solved()
    pose = geometry.cam2_from_cam1
    assert pose is not None and geometry.E is not None
    turned = replace(geometry, cam2_from_cam1=replace(pose, translation=np.zeros(3)))
    assert geometry.to_pycolmap().E is not None
    theirs = turned.to_pycolmap()
    assert theirs.E is None and theirs.F is not None and theirs.cam2_from_cam1 is not None
