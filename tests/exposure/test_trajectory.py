"""Ends of exposures from smears at known depth and a trajectory: exact motions, fractions, weights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.exposure.trajectory import (
    PATH_REACH,
    CameraPath,
    ExposedFrame,
    exposures,
    relative_motion,
    turning,
)
from blur2view.geometry.pose import rotation_matrix

PER_FRAME = np.array([0.01, -0.006, 0.004, 0.02, 0.03, -0.01])
OPEN_FOR = 0.6


def frame(motion: Array, time: float, count: int = 200, noise: float = 0.0) -> ExposedFrame:
    """Smears of a small motion, exact to first order but for noise."""
    rng = np.random.default_rng(int(time))
    rays, inverse = rng.uniform(-0.5, 0.5, (count, 2)), 1 / rng.uniform(1, 5, count)
    blank = ExposedFrame(time=time, rays=rays, displacement=0 * rays, inverse_depth=inverse)
    return replace(blank, displacement=blank.flow(motion) + noise * rng.normal(size=(count, 2)))


def path_of(poses: list[Array], times: Array | None = None) -> CameraPath:
    times = np.arange(len(poses), dtype=float) if times is None else times
    return CameraPath(times, np.stack(poses), PATH_REACH)


def steady(count: int) -> list[Array]:
    """Return the poses of a camera that repeats one motion."""
    R, t, poses = np.eye(3), np.zeros(3), []
    for _ in range(count):
        poses.append(np.column_stack([R, t]))
        step = rotation_matrix(PER_FRAME[:3])
        R, t = step @ R, step @ t + PER_FRAME[3:]
    return poses


def test_flow_is_the_motion_of_projected_points() -> None:
    one, small = frame(PER_FRAME, 0), 1e-6 * PER_FRAME
    points = np.column_stack([one.rays, np.ones(len(one.rays))]) / one.inverse_depth[:, None]
    moved = points + np.cross(small[:3], points) + small[3:]
    exact = moved[:, :2] / moved[:, 2:] - one.rays
    np.testing.assert_allclose(one.flow(small), exact, atol=1e-11)


def swing(period: float) -> tuple[CameraPath, Array]:
    """Return a camera that moves to and fro with a period in frames, and its true motions."""

    def pose(time: float) -> Array:
        phase = np.sin(2 * np.pi * time / period + np.array([0, 1, 2, 3, 4, 5]))
        R = rotation_matrix(0.05 * phase[:3])
        return np.column_stack([R, -R @ (0.01 * phase[3:])])

    true = [relative_motion(pose(k - OPEN_FOR / 2), pose(k + OPEN_FOR / 2)) for k in range(24)]
    return path_of([pose(k) for k in range(24)]), np.array(true)


@pytest.mark.parametrize("fraction", [0.3, -0.6])
def test_the_fraction_and_the_motion_are_those_of_exact_smears_though_some_are_outliers(
    fraction: float,
) -> None:
    frames, path = [frame(fraction * PER_FRAME, time) for time in range(9)], path_of(steady(9))
    for one in frames:
        one.displacement[:40] = np.random.default_rng(2).normal(0, 0.02, (40, 2))
    ends, found, measured = exposures(frames, path)
    assert found == pytest.approx(abs(fraction), rel=0.1) and measured
    motions = ends[:, 1] - ends[:, 0]
    np.testing.assert_allclose(motions[:, :3] - fraction * PER_FRAME[:3], 0, atol=1e-4)
    np.testing.assert_allclose(
        motions[:, 3:] / np.sign(fraction), np.tile(found * PER_FRAME[3:], (9, 1)), atol=3e-4
    )


def test_a_frame_with_too_few_smears_follows_the_trajectory_if_there_is_one() -> None:
    times = np.array([*range(8), 99.0])
    frames, path = [frame(PER_FRAME, time, count=3) for time in times], path_of(steady(9), times)
    ends, _, _ = exposures(frames, path, 0.4)
    np.testing.assert_allclose((ends[:8, 1] - ends[:8, 0]), np.tile(0.4 * PER_FRAME, (8, 1)), atol=3e-4)
    assert np.isnan(ends[8]).all()
    ends, fraction, _ = exposures(frames, path)
    assert np.isnan(fraction) and np.isnan(ends).all()


@pytest.mark.parametrize(("period", "follows"), [(8.0, 0.1), (1.05, 0.5)])  # the second seems slow in poses
def test_smears_show_that_a_shake_is_faster_than_frames_and_positions_are_those_of_the_trajectory(
    period: float, follows: float
) -> None:
    path, true = swing(period)
    spline = np.stack([path.ends(time, OPEN_FOR) for time in path.times])
    moved = spline[:, 1] - spline[:, 0]
    made = np.hstack([true[:, :3], moved[:, 3:]])
    ends, fraction, measured = exposures([frame(one, k, noise=1e-3) for k, one in enumerate(made)], path)
    assert measured == (period > 2)
    found, size = ends[:, 1] - ends[:, 0], np.linalg.norm(true[:, :3], axis=1).max()
    off, guessed = (np.linalg.norm(one[:, :3] - true[:, :3], axis=1) for one in (found, moved))
    assert np.median(off) < 0.1 * size and np.median(off) < follows * max(np.median(guessed), 0.1 * size)
    np.testing.assert_allclose(np.abs(found[:, 3:]), fraction / OPEN_FOR * np.abs(moved[:, 3:]), atol=1e-3)


@pytest.mark.parametrize("fraction", [0.5, -0.8, 0.02])
def test_the_camera_turned_as_smears_of_either_order_say_within_the_deviation(fraction: float) -> None:
    true = abs(fraction) * float(np.linalg.norm(PER_FRAME[:3]))
    angle, sigma = turning(frame(fraction * PER_FRAME, 0), PER_FRAME)
    assert angle == pytest.approx(true, rel=1e-6) and sigma < 1e-4 * true
    angle, sigma = turning(frame(fraction * PER_FRAME, 0, noise=0.1 * true), PER_FRAME)
    assert abs(angle - true) < 2 * sigma and sigma < 0.3 * true


def test_nothing_says_how_a_camera_turned_whose_frame_has_few_smears() -> None:
    assert turning(frame(PER_FRAME, 0, count=4), PER_FRAME) == (0.0, np.inf)
