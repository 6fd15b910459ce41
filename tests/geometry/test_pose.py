"""Poses: decomposition, cheirality, covariance, and the calibrated fit, against exact truth."""

from __future__ import annotations

import numpy as np
import pytest

from blur2view.geometry.configuration import Configuration
from blur2view.geometry.pose import (
    PoseCovariance,
    RigidTransform,
    before_both,
    decompose_essential,
    plane_basis,
    rotation_matrix,
    rotation_vector,
)
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.two_view.estimate import estimate_two_view
from tests.support.scenes import Scene, disturb, make_scene, with_outliers
from tools.metrics import rotation_error, squared_distance, translation_direction_error_deg

SEEDS = range(5)


def solve(scene: Scene, sigma_px: float = 0.1) -> TwoViewGeometry:
    return estimate_two_view(scene.matches(sigma_px), camera=scene.camera)


def true_pose(scene: Scene) -> RigidTransform:
    return RigidTransform(rotation=scene.R, translation=scene.t / np.linalg.norm(scene.t))


def rays(scene: Scene) -> np.ndarray:
    return scene.camera.rays(scene.ends)


def difference(one: RigidTransform, other: RigidTransform) -> float:
    return float(
        np.abs(one.rotation - other.rotation).max() + np.abs(one.translation - other.translation).max()
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_exact_smears_give_the_exact_pose_up_to_the_flip_of_time(seed: int) -> None:
    scene = make_scene(np.random.default_rng(seed), length_px=20)
    geometry = solve(scene)
    assert geometry.config is Configuration.CALIBRATED and geometry.cam2_from_cam1 is not None
    true = true_pose(scene)
    assert min(difference(geometry.cam2_from_cam1, flip) for flip in (true, true.inverse())) < 1e-4  # sigma
    assert geometry.E is not None and geometry.F is not None
    inverse = np.linalg.inv(scene.K)
    F = inverse.T @ geometry.E @ inverse
    np.testing.assert_allclose(geometry.F, F / np.linalg.norm(F), atol=1e-12)
    np.testing.assert_allclose(geometry.E, geometry.cam2_from_cam1.essential, atol=1e-12)
    right = (geometry.second_end_is_open == scene.swapped).mean()
    assert max(right, 1 - right) == 1.0  # every order, also where E alone leaves it open


@pytest.mark.slow
def test_known_intrinsics_give_the_pose() -> None:
    """Errors over 24 seeds beside those of the F of an assumed camera: no larger, less often large."""
    table = []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        scene = with_outliers(disturb(make_scene(rng, length_px=20), rng, noise_px=1.0), rng, 0.3)
        pose = solve(scene, 2.0).cam2_from_cam1
        F = estimate_two_view(scene.matches(2.0)).F
        assert pose is not None and F is not None
        plain = decompose_essential(scene.K.T @ F @ scene.K)[0]
        table.append([
            rotation_error(pose.rotation, scene.R)[1],
            translation_direction_error_deg(pose.translation, scene.t),
            rotation_error(plain.rotation, scene.R)[1],
            translation_direction_error_deg(plain.translation, scene.t),
        ])  # fmt: skip
    median, mean = np.median(table, axis=0), np.mean(table, axis=0)
    assert (median[:2] < [0.08, 1.5]).all() and (median[:2] < 1.05 * median[2:]).all()
    assert (mean[:2] < [0.1, 2.0]).all() and (mean[:2] < 0.9 * mean[2:]).all()


def test_points_lie_before_both_cameras_in_one_pose_of_four() -> None:
    scene = make_scene(np.random.default_rng(7), length_px=30)
    ends = rays(scene)
    one, two = (ends[np.arange(len(ends)), index] for index in (scene.swapped * 1, 1 - scene.swapped))
    assert before_both(true_pose(scene), one, two).all()
    poses = decompose_essential(true_pose(scene).essential)
    others = [pose for pose in poses if difference(pose, true_pose(scene)) > 1e-6]
    assert len(others) == 3
    assert all(not before_both(pose, one, two).all() for pose in others)
    assert before_both(true_pose(scene).inverse(), two, one).all()


def test_distance_of_a_pose_is_measured_in_standard_deviations() -> None:
    variances = np.diag([0.01, 0.01, 0.01, 0.25, 0.25])
    covariance = PoseCovariance(matrix=variances, tangents=np.eye(3)[:2])
    pose = RigidTransform(rotation=np.eye(3), translation=np.array([0.0, 0, 1]))
    turned = RigidTransform(rotation=rotation_matrix(np.array([0.2, 0, 0])), translation=pose.translation)
    assert np.isclose(squared_distance(covariance, pose, turned), 4)
    assert np.isclose(squared_distance(covariance, pose, turned, slice(0, 3)), 4)
    moved = RigidTransform(rotation=np.eye(3), translation=np.array([np.sin(0.5), 0, np.cos(0.5)]))
    assert np.isclose(squared_distance(covariance, pose, moved, slice(3, 5)), 1)
    assert squared_distance(covariance, pose, pose.inverse()) < 1e-12  # the other flip of time
    np.testing.assert_allclose(covariance.rotation_sigma_deg, np.degrees(0.1))
    assert np.isclose(covariance.translation_sigma_deg, np.degrees(0.5))


def test_an_error_of_a_pose_is_that_of_its_inverse() -> None:
    rng = np.random.default_rng(2)
    t, change = np.array([0.6, 0.0, 0.8]), 1e-4 * rng.normal(size=5)
    tangents = plane_basis(t)
    pose = RigidTransform(rotation=rotation_matrix(rng.normal(size=3)), translation=t)
    moved = t + change[3:] @ tangents
    true = RigidTransform(
        rotation=rotation_matrix(change[:3]) @ pose.rotation, translation=moved / np.linalg.norm(moved)
    )
    covariance = PoseCovariance(matrix=np.outer(change, change), tangents=tangents).inverse(pose)
    back, turned = pose.inverse(), true.inverse()
    error = np.append(
        rotation_vector(turned.rotation @ back.rotation.T), covariance.tangents @ turned.translation
    )
    np.testing.assert_allclose(covariance.matrix, np.outer(error, error), atol=1e-11)


def test_what_is_no_pose_or_covariance_is_refused() -> None:
    still = np.zeros(3)
    for R, t in ((np.eye(4), still), (-np.eye(3), still), (np.eye(3), np.ones(3))):
        with pytest.raises(ValueError, match="rotation|translation|shapes"):
            RigidTransform(rotation=R, translation=t)
