"""Motion during exposures from smears at known depth and a trajectory: exact motions, fractions, weights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.exposure.trajectory import ExposedFrame, Trajectory, common_fraction, exposure_motion, widened
from blur2view.geometry.rotation import rotation_matrix, rotation_vector

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


def swing(period: float, count: int = 24, reach: float = 0.1) -> tuple[Trajectory, Array]:
    """Return a camera that moves to and fro with a period in frames, so far, and its true velocities."""

    def pose(time: float) -> Array:
        phase = np.sin(2 * np.pi * time / period + np.array([0, 1, 2, 3, 4, 5]))
        R = rotation_matrix(0.05 * phase[:3])
        return np.column_stack([R, -R @ (reach * phase[3:])])

    true = []
    for k in range(count):
        first, last = pose(k - OPEN_FOR / 2), pose(k + OPEN_FOR / 2)
        R = last[:, :3] @ first[:, :3].T
        turn, move = rotation_vector(R), last[:, 3] - R @ first[:, 3]
        true.append(np.concatenate([turn, move - 0.5 * np.cross(turn, move)]) / OPEN_FOR)
    return Trajectory(poses=np.array([pose(k) for k in range(count)])), np.array(true)


OPEN_FOR = 0.6


def test_velocities_of_a_steady_camera_are_its_motion_per_frame() -> None:
    steady = Trajectory(poses=path(9))
    found = steady.velocities(OPEN_FOR)
    np.testing.assert_allclose(found[:, :3], np.tile(PER_FRAME[:3], (9, 1)), atol=1e-12)
    np.testing.assert_allclose(found[:, 3:], np.tile(PER_FRAME[3:], (9, 1)), atol=3e-4)
    assert steady.spreads(OPEN_FOR).max() < 0.05 * np.linalg.norm(PER_FRAME)
    np.testing.assert_allclose(steady.ends(OPEN_FOR).mean(axis=1), 0, atol=1e-4)  # it does not bend
    with pytest.raises(ValueError, match="two or more poses"):
        Trajectory(poses=path(1))


def test_a_slow_swing_is_followed_where_a_straight_line_is_not() -> None:
    slow, true = swing(period=8)
    inner = slice(3, -3)
    off = np.abs(slow.velocities(OPEN_FOR) - true)[inner]
    poses = slow.poses
    turns = [0.5 * rotation_vector(poses[k + 1, :, :3] @ poses[k - 1, :, :3].T) for k in range(3, 21)]
    assert off[:, :3].mean() < 0.2 * np.abs(np.array(turns) - true[inner, :3]).mean()
    spread = slow.spreads(OPEN_FOR)
    assert off.max() < 4 * spread[inner].max() and spread[inner].max() < 0.3 * np.abs(true).max()
    np.testing.assert_allclose(spread[0], 3 * spread[9])  # beyond the last frame it is less sure


def test_what_is_not_known_stays_so() -> None:
    poses = path(30)
    poses[[4, 6]] = np.nan
    found = Trajectory(poses=poses).velocities(OPEN_FOR)
    assert np.isnan(found[[4, 6]]).all() and np.isfinite(np.delete(found, [4, 6], axis=0)).all()


def test_smears_show_that_a_shake_is_faster_than_frames() -> None:
    rng = np.random.default_rng(7)
    factors = []
    for period in (8.0, 1.05):  # the second looks slow in the poses
        trajectory, true = swing(period, reach=0.01)
        velocity, spreads = trajectory.velocities(OPEN_FOR), trajectory.spreads(OPEN_FOR)
        made = [frame(rng, OPEN_FOR * own, velocity=seen) for own, seen in zip(true, velocity, strict=True)]
        frames = [replace(one, displacement=one.displacement + rng.normal(0, 1e-3, (200, 2))) for one in made]
        wide = widened(frames, OPEN_FOR, spreads)
        factors.append(wide[9, 0] / spreads[9, 0])
        moved = [exposure_motion(one, OPEN_FOR, own) for one, own in zip(frames, wide, strict=True)]
        turned = np.array([one[:3] for one in moved if one is not None])
        off = np.linalg.norm(turned - OPEN_FOR * true[:, :3], axis=1)
        assert np.median(off) < 0.1 * OPEN_FOR * np.abs(true[:, :3]).max()
        places = np.array([one[3:] for one in moved if one is not None])
        np.testing.assert_allclose(np.abs(places), OPEN_FOR * np.abs(velocity[:, 3:]), atol=1e-3)
    assert factors[1] > 5 * factors[0]


def test_nothing_is_expected_of_a_trajectory_that_knows_nothing() -> None:
    trajectory, _ = swing(period=8)
    size = np.abs(trajectory.velocities(OPEN_FOR)).max()
    np.testing.assert_array_equal(trajectory.shares(OPEN_FOR, np.full((24, 6), size)), 0)
    np.testing.assert_allclose(trajectory.shares(OPEN_FOR, np.full((24, 6), 1e-3 * size)), 1, atol=1e-4)
