"""The time direction: exact videos of smears, matches of pictures, and what must stay open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.camera import Camera
from blur2view.exposure.sequence import (
    GAP_FRAMES,
    PictureMotion,
    directed,
    extract_features,
    frame_times,
    match_features,
    picture_motion,
)
from blur2view.exposure.views import ExposureViews, other_translation
from blur2view.geometry.configuration import Configuration
from blur2view.geometry.epipolar import fundamental_from_pose
from blur2view.geometry.pose import RigidTransform, rotation_matrix
from blur2view.geometry.two_view_geometry import TimeDirection, TwoViewGeometry

SIZE = (640, 480)
CAMERA = Camera.from_focal(600.0, SIZE)
INTERVAL = 2.0  # exposures from frame to frame


@dataclass(frozen=True, kw_only=True)
class Clip:
    """A camera at constant velocity before scattered points, at mid exposure of the middle frame."""

    pixels: Array
    depth: Array
    turn: Array  # per exposure
    move: Array

    def seen(self, tau: float) -> Array:
        """Where the points are at a time in exposures, pixels."""
        rays = np.column_stack([CAMERA.rays(self.pixels), np.ones(len(self.pixels))]) * self.depth[:, None]
        moved = (rays @ rotation_matrix(tau * self.turn).T + tau * self.move) @ CAMERA.K.T
        return moved[:, :2] / moved[:, 2:]


def clip(seed: int) -> Clip:
    """Smears of about ten pixels, half of rotation, half of translation."""
    rng = np.random.default_rng(seed)
    axis, heading = rng.normal(size=3), rng.normal(size=3)
    pixels, depth = rng.uniform(0.1, 0.9, (300, 2)) * SIZE, np.exp(rng.uniform(0, np.log(5.0), 300))
    turn, move = 0.008 * axis / np.linalg.norm(axis), 0.03 * heading / np.linalg.norm(heading)
    return Clip(pixels=pixels, depth=depth, turn=turn, move=move)


def views(scene: Clip) -> ExposureViews:
    """Exact views of the middle frame."""
    first, last, R = scene.seen(-0.5), scene.seen(0.5), rotation_matrix(scene.turn)
    t = scene.move + R @ scene.move
    t /= np.linalg.norm(t)
    geometry = TwoViewGeometry(
        F=fundamental_from_pose(CAMERA.K, R, t),
        cam2_from_cam1=RigidTransform(rotation=R, translation=t),
        config=Configuration.CALIBRATED,
        inlier_mask=np.ones(len(first), bool),
        second_end_is_open=np.zeros(len(first), bool),
    )
    return ExposureViews(
        name="a.jpg",
        size=SIZE,
        points_open=first,
        points_close=last,
        sampson_px=np.full(len(first), 0.25),
        geometry=geometry,
        camera=CAMERA,
    )


def motion(scene: Clip) -> PictureMotion:
    """Give what the frames before and after show."""
    return picture_motion({k: (scene.seen(0.0), scene.seen(INTERVAL * k)) for k in (-1, 1)}, CAMERA)


def time_reversed(given: ExposureViews) -> ExposureViews | None:
    return given.reversed()


@pytest.mark.parametrize("wrong", [replace, time_reversed, other_translation])
@pytest.mark.parametrize("seed", range(3))
def test_neighbours_decide_the_signs_of_time_and_translation(
    seed: int, wrong: Callable[[ExposureViews], ExposureViews | None]
) -> None:
    scene = clip(seed)
    given = wrong(views(scene))
    assert given is not None
    shown = motion(scene)
    np.testing.assert_allclose(shown.rotation, 2 * INTERVAL * scene.turn, atol=1e-3)  # by both neighbours
    found = directed(given, shown)
    near, far = (np.linalg.norm(found.points_open - scene.seen(tau), axis=1) for tau in (-0.5, 0.5))
    assert (near < far).all()
    assert found.time.known and found.time.confidence > 0.95
    pose = found.geometry.cam2_from_cam1
    assert pose is not None and pose.rotation_vector @ scene.turn > 0 and pose.translation @ scene.move > 0


def test_no_neighbours_no_matches_and_no_inliers_leave_the_direction_open() -> None:
    scene = clip(6)
    given = views(scene)
    few, still = (
        picture_motion({1: (scene.pixels[:5], scene.pixels[:5] + 1)}),
        picture_motion({1: (scene.pixels,) * 2}),
    )
    none = replace(given, geometry=replace(given.geometry, inlier_mask=np.zeros(300, bool)))
    for found in (
        directed(given, picture_motion({})),
        directed(given, few),
        directed(given, still),
        directed(none, motion(scene)),
    ):
        assert found.time == TimeDirection(known=False, confidence=0.0)
        np.testing.assert_array_equal(found.points_open, given.points_open)


@pytest.mark.parametrize(
    ("names", "steps"),
    [
        ([f"a/f_{k:03d}.jpg" for k in (0, 10, 20, 40, 50, 55, 65)], [1, 1, 2, 1, 0.5, 1]),
        ([f"frame_{k:05d}.png" for k in (3, 6, 16, 21)], [0.6, 2, 1]),
        ([f"{side}/{k}.jpg" for side in "lr" for k in (1, 2, 4)], [1, 2, GAP_FRAMES, 1, 2]),
        (["b.jpg", "a.jpg", "f_1.jpg"], [1, 1]),
        (["f_9998.jpg", "f_9999.jpg", "f_0000.jpg", "f_0001.jpg"], [1, GAP_FRAMES, 1]),
        (["1403636579763555584.png", "1403636579813555456.png"], [1]),
        ([], []),
    ],
    ids=["left out", "irregular", "folders", "names", "fallen", "nanoseconds", "none"],
)
def test_numbers_under_one_stem_are_times(names: list[str], steps: list[float]) -> None:
    np.testing.assert_allclose(np.diff(frame_times(names)), steps)


def texture(size: tuple[int, int], seed: int = 0) -> np.ndarray:
    """Give spots of all sizes, (H, W) uint8."""
    rng = np.random.default_rng(seed)
    layers = [cv2.GaussianBlur(rng.normal(size=size[::-1]), (0, 0), s) * s for s in (1.5, 3, 6, 12)]
    noise = np.sum(layers, axis=0)
    return np.asarray(255 * (noise - noise.min()) / np.ptp(noise), np.uint8)


def detect(grey: np.ndarray) -> tuple[Array, np.ndarray]:
    """Return the features of a grey picture (H, W) uint8."""
    return extract_features(np.repeat(grey[..., None] / np.float32(255), 3, axis=2))


def test_matches_of_a_shifted_picture_are_its_shift() -> None:
    picture, shift = texture((320, 240)), np.array([12.0, -5.0])
    moved = cv2.warpAffine(
        picture, np.column_stack([np.eye(2), shift]), (320, 240), borderMode=cv2.BORDER_REFLECT
    )
    points1, points2 = match_features(detect(picture), detect(np.asarray(moved)))
    assert len(points1) > 50
    np.testing.assert_allclose(np.median(points2 - points1, axis=0), shift, atol=0.1)
    assert (np.linalg.norm(points2 - points1 - shift, axis=1) < 2).mean() > 0.95


def test_features_of_a_large_picture_lie_where_those_of_the_small_one_do() -> None:
    small = texture((640, 480))
    points, _ = detect(small)
    there, _ = detect(small.repeat(2, axis=0).repeat(2, axis=1))
    np.testing.assert_allclose(there, 2 * points + 0.5, atol=1e-3)


def test_blank_and_unrelated_pictures_have_no_matches() -> None:
    blank = detect(np.full((240, 320), 90, np.uint8))
    one, other = (detect(texture((320, 240), seed)) for seed in (0, 1))
    assert blank[0].shape == (0, 2) and blank[1].shape == (0, 128)  # SIFT's
    for pair in ((blank, one), (one, blank), (one, other)):
        points1, points2 = match_features(*pair)
        assert points1.shape == points2.shape == (0, 2)
