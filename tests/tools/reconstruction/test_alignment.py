"""Alignment of models to truth: exact recovery, and errors that are what they are called."""

import numpy as np
import pytest

from blur2view.geometry.rotation import rotation_matrix
from tools.reconstruction.alignment import (
    Motion,
    MotionErrors,
    align,
    centres,
    common_scale,
    rotation_errors_deg,
)


def random_poses(rng: np.random.Generator, count: int, line: bool = False) -> np.ndarray:
    places = rng.normal(size=(count, 1)) * [1.0, 2, 3] if line else rng.normal(size=(count, 3))
    rotations = [rotation_matrix(rng.normal(size=3)) for _ in range(count)]
    return np.stack([np.column_stack([R, -R @ place]) for R, place in zip(rotations, places, strict=True)])


@pytest.mark.parametrize("line", [False, True])
def test_alignment_recovers_a_similarity_even_of_cameras_on_a_line(line: bool) -> None:
    rng = np.random.default_rng(0)
    true = random_poses(rng, 6, line)
    S, scale, shift = rotation_matrix(rng.normal(size=3)), 0.3, rng.normal(size=3)
    # the same cameras in a frame X_model = S^T (X - shift) / scale
    R = true[..., :3] @ S
    model = np.concatenate([R, ((true[..., 3] + true[..., :3] @ shift) / scale)[..., None]], axis=-1)
    found = align(model, true)
    assert found.scale == pytest.approx(scale)
    np.testing.assert_allclose(found.poses(model), true, atol=1e-9)
    np.testing.assert_allclose(centres(found.poses(model)), centres(true), atol=1e-9)


def test_alignment_needs_two_cameras() -> None:
    with pytest.raises(ValueError, match=r"\(1, 3, 4\)"):
        align(np.zeros((1, 3, 4)), np.zeros((1, 3, 4)))


def test_rotation_errors_are_angles() -> None:
    rng = np.random.default_rng(1)
    true = random_poses(rng, 3)
    turned = true.copy()
    turned[:, :, :3] = rotation_matrix(np.radians([0, 2.0, 0])) @ true[:, :, :3]
    np.testing.assert_allclose(rotation_errors_deg(turned, true), 2.0, atol=1e-6)


def test_reversed_motion_is_told_and_missing_frames_stay_missing() -> None:
    rng = np.random.default_rng(2)
    first = random_poses(rng, 4)
    last = first.copy()
    for pose, turn, move in zip(last, rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), strict=True):
        R = rotation_matrix(0.01 * turn)
        pose[:] = np.column_stack([R @ pose[:, :3], R @ pose[:, 3] + 0.1 * move])
    true = Motion.between(first, last)
    assert MotionErrors.of(true, true).rotation.max() < 1e-12
    first[3] = np.nan
    errors = MotionErrors.of(Motion.between(last, first), true)
    np.testing.assert_array_equal(errors.forward, [0, 0, 0, np.nan])
    np.testing.assert_allclose(errors.rotation[:3], 2, rtol=1e-2)
    assert np.isnan(errors.rotation[3]) and (errors.heading_deg[:3] > 170).all()
    assert common_scale(0.4 * true.rotations, true.rotations) == pytest.approx(0.4)
