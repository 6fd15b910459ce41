"""Estimates of smaller copies: the same motion in other pixels."""

from dataclasses import replace

import numpy as np
import pytest

from blur2view.camera.camera import Camera
from blur2view.geometry.sampson import serrmin
from blur2view.segmentation.features import motion_features
from blur2view.segmentation.reduced import reduced_estimate, reduced_image, reduced_shape, resizing
from blur2view.segmentation.score import displacement_of, motion_score
from blur2view.smears.field import smear_ends
from blur2view.smears.sampling import GridSmears
from tests.support.motion_scenes import SHIFT, estimate_of, sideways, with_mover

FULL, HALF = (240, 320), (120, 160)


def test_sides_shrink_to_the_longest_and_never_vanish() -> None:
    assert reduced_shape((720, 1280), 640) == (360, 640) and reduced_shape((480, 640), 640) == (480, 640)
    assert reduced_shape((2, 2000), 320) == (1, 320) and reduced_shape((1, 1), 320) == (1, 1)


def test_pictures_are_averaged_and_small_ones_left_alone() -> None:
    large = np.random.default_rng(0).random((100, 640, 3), dtype=np.float32)
    assert reduced_image(large, 640) is large
    small = reduced_image(large, 320)
    np.testing.assert_allclose(small, large.reshape(50, 2, 320, 2, 3).mean(axis=(1, 3)), atol=1e-5)


def test_corners_fall_on_corners() -> None:
    corner = np.array([319.5, 239.5, 1])
    np.testing.assert_allclose(resizing(FULL, (90, 80)) @ corner, [79.5, 89.5, 1])
    np.testing.assert_allclose(resizing(FULL, (90, 80)) @ [-0.5, -0.5, 1], [-0.5, -0.5, 1])


def test_residuals_shrink_with_the_photograph() -> None:
    F = np.random.default_rng(1).normal(size=(3, 3)) * [
        [1e-4, 1e-4, 1e-2],
        [1e-4, 1e-4, 1e-2],
        [1e-2, 1e-2, 1],
    ]
    small = reduced_estimate(estimate_of(with_mover(), F=F), HALF)
    assert small.field.shape == HALF and small.geometry.F is not None
    smears = GridSmears.of(small.field)
    ends = smear_ends(smears.points, smears.displacement)
    large = 2 * (ends + 0.5) - 0.5  # the same points in the photograph's pixels
    np.testing.assert_allclose(serrmin(small.geometry.F, ends), serrmin(F, large) / 4, rtol=1e-6)


def test_homographies_carry_the_same_points() -> None:
    small = reduced_estimate(estimate_of(sideways(), H=SHIFT), HALF).geometry.H
    assert small is not None
    np.testing.assert_allclose(displacement_of(small, np.array([[10.0, 20.0]])), SHIFT[:2, 2][None] / 2)


def test_features_are_those_of_a_photograph_that_was_small_at_once() -> None:
    F = np.array([[0, 0, 0], [0, 0, -1.0], [0, 1, 0]])
    small = reduced_estimate(estimate_of(with_mover(), F=F), HALF)
    once = estimate_of((with_mover()[::2, ::2] / 2).astype(np.float32), F=F, sigma_px=0.5)
    np.testing.assert_allclose(
        motion_features(small, motion_score(small)), motion_features(once, motion_score(once)), atol=1e-5
    )


def test_own_size_changes_nothing_and_cameras_shrink() -> None:
    camera = Camera.from_string("SIMPLE_RADIAL 320 240 220 160 120 -0.05")
    found = replace(estimate_of(sideways(), F=np.eye(3)), camera=camera)
    assert reduced_estimate(found, FULL) is found
    small = reduced_estimate(found, HALF)
    assert small.camera is not None and small.camera.focal_px == pytest.approx(110)
    assert (small.camera.width, small.camera.height) == (160, 120)
    assert small.matches is found.matches
