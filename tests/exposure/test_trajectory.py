"""Motion during exposures from smears at known depth and a trajectory: exact motions, fractions, weights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.exposure.trajectory import (
    ExposedFrame,
    common_fraction,
    exposure_motion,
    roughness,
    smooth_velocities,
    velocities,
)
from blur2view.geometry.rotation import rotation_matrix

PER_FRAME = np.array([0.01, -0.006, 0.004, 0.02, 0.03, -0.01])
SPREAD = np.repeat([1e-3, 3e-3], 3)


def frame(
    rng: np.random.Generator, motion: Array, count: int = 200, velocity: Array | None = PER_FRAME
) -> ExposedFrame:
    """Smears of a small motion, exact to first order."""
    rays = rng.uniform(-0.5, 0.5, (count, 2))
    inverse = 1 / rng.uniform(1, 5, count)
    blank = ExposedFrame(rays=rays, displacement=0 * rays, inverse_depth=inverse, velocity=velocity)
    return replace(blank, displacement=blank.rows @ motion)


def path(count: int, noise: float = 0.0) -> Array:
    """Poses cam_from_world of a camera that repeats one motion."""
    rng, R, t, poses = np.random.default_rng(0), np.eye(3), np.zeros(3), []
    for _ in range(count):
        shaken = rotation_matrix(noise * rng.normal(size=3))
        poses.append(np.column_stack([shaken @ R, shaken @ t]))
        step = rotation_matrix(PER_FRAME[:3])
        R, t = step @ R, step @ t + PER_FRAME[3:]
    return np.stack(poses)


def test_flow_is_the_motion_of_points_in_space() -> None:
    rng = np.random.default_rng(1)
    motion = 1e-6 * rng.normal(size=6)
    made = frame(rng, motion)
    X = np.column_stack([made.rays, np.ones(len(made.rays))]) / made.inverse_depth[:, None]
    moved = X @ rotation_matrix(motion[:3]).T + motion[3:]
    np.testing.assert_allclose(moved[:, :2] / moved[:, 2:] - made.rays, made.displacement, atol=1e-10)


@pytest.mark.parametrize("fraction", [0.3, 1.0, -0.6])
def test_the_fraction_and_the_motion_are_those_of_exact_smears(fraction: float) -> None:
    made = frame(np.random.default_rng(2), fraction * PER_FRAME)
    assert made.fraction == pytest.approx(fraction)
    assert common_fraction([made]) == pytest.approx(abs(fraction))
    found = exposure_motion(made, abs(fraction), SPREAD)
    assert found is not None
    np.testing.assert_allclose(found, fraction * PER_FRAME, atol=1e-9)


def test_without_neighbours_smears_alone_give_the_motion_though_some_are_outliers() -> None:
    rng = np.random.default_rng(3)
    made = frame(rng, 0.5 * PER_FRAME, velocity=None)
    spoilt = made.displacement.copy()
    spoilt[:40] = rng.normal(0, 0.02, (40, 2))
    found = exposure_motion(replace(made, displacement=spoilt), float("nan"), SPREAD)
    assert found is not None
    np.testing.assert_allclose(found, 0.5 * PER_FRAME, atol=1e-5)


def test_a_sure_trajectory_outweighs_smears_and_a_rough_one_does_not() -> None:
    other = 0.5 * PER_FRAME + np.array([2e-3, 0, 0, 0, 0, 0])
    made = frame(np.random.default_rng(4), other)
    sure, rough = (exposure_motion(made, 0.5, scale * SPREAD) for scale in (1e-4, 1e3))
    assert sure is not None and rough is not None
    assert np.linalg.norm(sure - 0.5 * PER_FRAME) < 0.2 * np.linalg.norm(sure - other)
    np.testing.assert_allclose(rough, other, atol=1e-6)


def test_a_frame_with_too_few_smears_follows_the_trajectory_if_there_is_one() -> None:
    few = frame(np.random.default_rng(5), PER_FRAME, count=3)
    assert np.isnan(few.fraction)
    found = exposure_motion(few, 0.4, SPREAD)
    assert found is not None
    np.testing.assert_allclose(found, 0.4 * PER_FRAME)
    assert exposure_motion(few, float("nan"), SPREAD) is None
    assert exposure_motion(replace(few, velocity=None), 0.4, SPREAD) is None
    assert np.isnan(common_fraction([few]))


def test_velocities_of_a_steady_camera_are_its_motion_per_frame() -> None:
    found = velocities(path(7))
    np.testing.assert_allclose(found[:, :3], np.tile(PER_FRAME[:3], (7, 1)), atol=1e-12)
    np.testing.assert_allclose(found[:, 3:], np.tile(PER_FRAME[3:], (7, 1)), atol=3e-4)
    with pytest.raises(ValueError, match="two or more poses"):
        velocities(path(1))


def test_smoothing_lowers_the_noise_of_poses_and_keeps_what_is_not_known() -> None:
    poses = path(30, noise=5e-4)
    poses[4] = np.nan
    plain, smooth = velocities(poses), smooth_velocities(poses)
    assert np.isnan(smooth[[3, 5]]).all() and np.isfinite(smooth[6:]).all()  # 4 is told by both
    off = [np.abs(found[6:, :3] - PER_FRAME[:3]).mean() for found in (plain, smooth)]
    assert off[1] < 0.6 * off[0]
    np.testing.assert_array_equal(smooth_velocities(path(4)), velocities(path(4)))


def test_roughness_is_the_size_of_white_noise_and_nothing_on_a_line() -> None:
    rng = np.random.default_rng(6)
    noisy = PER_FRAME + rng.normal(size=(400, 6)) * np.repeat([1e-3, 1e-2], 3)
    np.testing.assert_allclose(roughness(noisy), np.repeat([1e-3, 1e-2], 3), rtol=0.25)
    np.testing.assert_allclose(roughness(np.linspace(0, 1, 9)[:, None] * PER_FRAME), 0, atol=1e-12)


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match="expected rays"):
        ExposedFrame(
            rays=np.zeros((3, 2)), displacement=np.zeros((2, 2)), inverse_depth=np.ones(3), velocity=None
        )
