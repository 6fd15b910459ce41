"""Our two-view geometry as pycolmap's: it finds the same from the same points, in its own pixels."""

from dataclasses import replace

import numpy as np
import pycolmap
import pytest

from blur2view.camera import to_colmap
from blur2view.geometry.configuration import Configuration
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.two_view.estimate import estimate_two_view
from tests.support.scenes import IMAGE_SIZE, Scene, make_scene
from tools.metrics import translation_direction_error_deg

COUNT = 400
NONE = np.zeros(5, bool)


def solved() -> tuple[Scene, TwoViewGeometry]:
    scene = make_scene(np.random.default_rng(0), count=COUNT, length_px=30.0, rotation_share=0.5)
    return scene, estimate_two_view(scene.matches(0.1), camera=scene.camera)


def ordered(scene: Scene, geometry: TwoViewGeometry) -> tuple[np.ndarray, np.ndarray]:
    """COLMAP's pixels of the open and of the close ends, as the geometry orders them."""
    index, swapped = np.arange(COUNT), geometry.second_end_is_open.astype(int)
    return to_colmap(scene.ends[index, swapped]), to_colmap(scene.ends[index, 1 - swapped])


def test_pycolmap_estimates_the_same_from_the_same_points() -> None:
    scene, geometry = solved()
    ours = geometry.to_pycolmap()
    assert ours.config == pycolmap.TwoViewGeometryConfiguration.CALIBRATED and ours.cam2_from_cam1 is not None
    points1, points2 = ordered(scene, geometry)
    params = [scene.K[0, 0], scene.K[1, 1], *to_colmap(scene.K[:2, 2])]
    camera = pycolmap.Camera(model="PINHOLE", width=IMAGE_SIZE[0], height=IMAGE_SIZE[1], params=params)
    matches = np.arange(COUNT, dtype=np.uint32)[:, None].repeat(2, axis=1)
    theirs = pycolmap.estimate_calibrated_two_view_geometry(camera, points1, camera, points2, matches)
    pycolmap.estimate_two_view_geometry_pose(camera, points1, camera, points2, theirs)
    assert theirs.cam2_from_cam1 is not None
    turn = ours.cam2_from_cam1.rotation.inverse() * theirs.cam2_from_cam1.rotation
    assert np.degrees(turn.angle()) < 0.02
    direction = theirs.cam2_from_cam1.translation
    assert ours.cam2_from_cam1.translation @ direction > 0
    assert translation_direction_error_deg(ours.cam2_from_cam1.translation, direction) < 1
    np.testing.assert_allclose(ours.E, pycolmap.essential_matrix_from_pose(ours.cam2_from_cam1), atol=1e-9)


def test_F_and_H_are_of_colmaps_pixels_half_a_pixel_from_ours() -> None:
    rng = np.random.default_rng(1)
    points, F, H = rng.uniform(0, 100, (20, 2)), rng.normal(size=(3, 3)), np.eye(3)
    H = H + 1e-3 * rng.normal(size=(3, 3))
    geometry = TwoViewGeometry(
        F=F, H=H, config=Configuration.PLANAR, inlier_mask=NONE, second_end_is_open=NONE
    )
    theirs, half = geometry.to_pycolmap(), np.array([0.5, 0.5, 0])
    x, y = np.c_[points, np.ones(20)], np.c_[points[::-1], np.ones(20)]
    there, moved = x @ H.T, (x + half) @ theirs.H.T
    np.testing.assert_allclose(moved[:, :2] / moved[:, 2:], there[:, :2] / there[:, 2:] + 0.5, atol=1e-9)
    before = np.einsum("ni,ij,nj->n", y, F, x)
    after = np.einsum("ni,ij,nj->n", y + half, theirs.F, x + half)
    np.testing.assert_allclose(after * (before[0] / after[0]), before, rtol=1e-9)
    assert np.linalg.norm(theirs.F) == pytest.approx(1)


@pytest.mark.parametrize("config", Configuration)
def test_every_configuration_has_its_namesake(config: Configuration) -> None:
    geometry = TwoViewGeometry(F=None, config=config, inlier_mask=NONE, second_end_is_open=NONE)
    theirs = geometry.to_pycolmap()
    assert pycolmap.TwoViewGeometryConfiguration(theirs.config).name == config.name
    assert theirs.F is None and theirs.E is None and theirs.cam2_from_cam1 is None


def test_reversed_time_is_pycolmaps_inverse() -> None:
    _, geometry = solved()
    geometry = replace(geometry, H=np.array([[1.0, 0.02, 5], [-0.01, 1.03, -3], [1e-5, 2e-5, 1]]))
    theirs = geometry.to_pycolmap()
    theirs.invert()
    ours = geometry.reversed().to_pycolmap()
    for name in ("F", "E", "H"):
        first, second = (one / np.linalg.norm(one) for one in (getattr(ours, name), getattr(theirs, name)))
        np.testing.assert_allclose(first * np.sign((first * second).sum()), second, atol=1e-9)
    np.testing.assert_allclose(ours.cam2_from_cam1.matrix(), theirs.cam2_from_cam1.matrix(), atol=1e-9)


def test_a_pose_without_translation_has_no_E() -> None:
    _, geometry = solved()
    assert geometry.cam2_from_cam1 is not None
    turned = replace(geometry, cam2_from_cam1=replace(geometry.cam2_from_cam1, translation=np.zeros(3)))
    theirs = turned.to_pycolmap()
    assert theirs.E is None and theirs.F is not None and theirs.cam2_from_cam1 is not None
