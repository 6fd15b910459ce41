"""Rolling shutters against an exact simulation: the true motion is one of the two orders in time."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from blur2view import (
    Camera,
    Configuration,
    Parallax,
    RollingShutter,
    SmearMatches,
    TwoViewGeometry,
    estimate_two_view,
)
from blur2view.arrays import Array
from tests.support.scenes import IMAGE_SIZE, make_scene

WIDTH, HEIGHT, FOCAL = 640, 480, 600.0
EXPOSURE_S, COUNT = 0.02, 400
ABOUT_X, ABOUT_Y, ABOUT_Z = np.eye(3)
STILL = np.zeros(3)
CAMERA = Camera.from_focal(FOCAL, (WIDTH, HEIGHT))


def scene(deep: bool) -> Array:
    """Return points (N, 3) that are seen all over the picture, at one depth or at many."""
    rng = np.random.default_rng(0)
    pixels = rng.uniform((0, 0), (WIDTH, HEIGHT), (COUNT, 2))
    rays = np.column_stack([(pixels - CAMERA.K[:2, 2]) / FOCAL, np.ones(len(pixels))])
    return rays * (rng.uniform(1, 4, (COUNT, 1)) if deep else 2.0)


def turned(points: Array, rotation: Array, share: Array) -> Array:
    """Return points (N, 3) turned by shares (N,) of a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(rotation))
    axis = rotation / max(angle, 1e-12)
    cosine, sine = np.cos(angle * share)[:, None], np.sin(angle * share)[:, None]
    along = np.outer(points @ axis, axis)
    return np.asarray(along + cosine * (points - along) + sine * np.cross(axis, points))


def smears(points: Array, shutter: RollingShutter, rotation: Array, moved: Array = STILL) -> Array:
    """Return both ends (N, 2, 2), open first, of points of a camera that turns and moves at constant rates.

    ``rotation`` and ``moved`` are those of one exposure time; the points are given as the middle row has them
    in the middle of its exposure.
    """
    towards = np.array(shutter.towards)
    rows = abs(towards) @ (WIDTH, HEIGHT) - 1

    def at(times: Array) -> Array:
        share = times / shutter.exposure_s
        seen = (turned(points, rotation, share) + np.outer(share, moved)) @ CAMERA.K.T
        return np.asarray(seen[:, :2] / seen[:, 2:])

    ends = []
    for after in (0.0, shutter.exposure_s):
        times = np.full(len(points), after)
        for _ in range(25):  # to the time at which the row that the point is on by then opens, or closes
            row = (at(times) - CAMERA.K[:2, 2]) @ towards / rows
            times = after - shutter.exposure_s / 2 + shutter.readout_s * row
        ends.append(at(times))
    return np.stack(ends, axis=1)


def solve(ends: Array, shutter: RollingShutter | None, seed: int = 0) -> TwoViewGeometry:
    """Return the geometry of smears in random order, with errors of a tenth of a pixel."""
    rng = np.random.default_rng(seed)
    swapped = rng.random(len(ends)) < 0.5
    ends = np.where(swapped[:, None, None], ends[:, ::-1], ends) + rng.normal(0, 0.1, ends.shape)
    matches = SmearMatches(ends=ends, sigma_px=np.full(len(ends), 0.5), image_size=(WIDTH, HEIGHT))
    return estimate_two_view(matches, camera=CAMERA, shutter=shutter)


def vectors(geometry: TwoViewGeometry) -> list[Array]:
    """Return the rotation vectors of both orders in time."""
    poses = [flip.cam2_from_cam1 for flip in (geometry, geometry.reversed())]
    return [pose.rotation_vector for pose in poses if pose is not None]


def error(vector: Array, true: Array) -> float:
    return float(np.linalg.norm(vector - true) / np.linalg.norm(true))


@pytest.mark.parametrize(
    ("axis", "towards"),
    [
        (ABOUT_X, (0, 1)), (ABOUT_Y, (1, 0)), (-ABOUT_Y, (-1, 0)), (ABOUT_Y, (0, 1)),
        ((ABOUT_X + ABOUT_Y) / 2, (0, 1)),
    ],
    ids=str,
)  # fmt: skip
def test_one_order_has_the_rotation_and_the_other_leaves_the_same_smears(
    axis: Array, towards: tuple[int, int]
) -> None:
    shutter = RollingShutter(readout_s=0.03, exposure_s=EXPOSURE_S, towards=towards)
    points, rotation = scene(deep=False), 0.06 * axis
    ends = smears(points, shutter, rotation)
    geometry = solve(ends, shutter)
    assert geometry.parallax is not Parallax.PROVEN
    true, other = sorted(vectors(geometry), key=lambda vector: error(vector, rotation))
    assert error(true, rotation) < 0.01
    if abs(ABOUT_Y if towards[0] else ABOUT_X) @ axis:  # points move with the rows, or against them
        assert min(error(vector, rotation) for vector in vectors(solve(ends, None))) > 0.02
    middle = (ends.mean(axis=1) - CAMERA.K[:2, 2]) / FOCAL
    delays = 0.03 / EXPOSURE_S * FOCAL * middle @ towards / (HEIGHT - 1 if towards[1] else WIDTH - 1)
    rays = np.column_stack([middle, np.ones(len(middle))])
    there = turned(rays, other, -delays)
    assert np.median(np.abs(smears(there, shutter, other)[:, ::-1] - ends)) < 0.5


@pytest.mark.parametrize("sign", [1, -1])
def test_rotation_about_the_optical_axis_is_no_parallax(sign: int) -> None:
    shutter = RollingShutter(readout_s=0.03, exposure_s=EXPOSURE_S)
    rotation = 0.08 * sign * ABOUT_Z
    geometry = solve(smears(scene(deep=False), shutter, rotation), shutter)
    assert geometry.parallax is Parallax.ABSENT
    assert min(error(vector, rotation) for vector in vectors(geometry)) < 0.01


@pytest.mark.parametrize(
    ("readout_s", "rotation", "moved", "within"),
    [
        (0.03, 0.04 * ABOUT_X + 0.01 * ABOUT_Z, (0.02, 0.03, 0.05), 0.02),
        (0.045, 0.05 * ABOUT_X + 0.03 * ABOUT_Z, (0.02, 0.03, 0.15), 0.02),
    ],
    ids=["30 ms", "45 ms"],
)
def test_proven_parallax_keeps_its_rotation_and_translation(
    readout_s: float, rotation: Array, moved: tuple[float, float, float], within: float
) -> None:
    shutter = RollingShutter(readout_s=readout_s, exposure_s=EXPOSURE_S)
    ends, heading = smears(scene(deep=True), shutter, rotation, np.array(moved)), np.array(moved)

    def missed(geometry: TwoViewGeometry) -> tuple[float, float]:
        assert geometry.config is Configuration.CALIBRATED
        poses = [flip.cam2_from_cam1 for flip in (geometry, geometry.reversed())]
        return min(
            (
                error(pose.rotation_vector, rotation),
                float(np.degrees(np.arccos(pose.translation @ heading / np.linalg.norm(heading)))),
            )
            for pose in poses
            if pose is not None
        )

    for seed in range(5):
        turned, towards = missed(solve(ends, shutter, seed))
        assert turned < within and towards < 2
    assert missed(solve(ends, None))[0] > 0.05


def test_a_smear_faster_than_the_rows_tells_the_order_in_time() -> None:
    shutter = RollingShutter(readout_s=0.2, exposure_s=EXPOSURE_S)
    rotation = -0.04 * ABOUT_X  # points move down, with the rows, which see them for longer
    geometry = solve(smears(scene(deep=False), shutter, rotation), shutter)
    assert geometry.backward is None and "other order in time" in geometry.reason
    assert geometry.cam2_from_cam1 is not None
    assert error(geometry.cam2_from_cam1.rotation_vector, rotation) < 0.02


@pytest.mark.parametrize(
    "wrong",
    [
        {"readout_s": -0.01}, {"readout_s": np.nan}, {"readout_s": 1.5}, {"exposure_s": 0.0},
        {"exposure_s": np.inf}, {"towards": (1, 1)},
    ],
    ids=str,
)  # fmt: skip
def test_wrong_values_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="got"):
        RollingShutter(**{"readout_s": 0.02, "exposure_s": 0.02} | wrong)


def test_a_shutter_without_known_intrinsics_is_refused() -> None:
    matches = SmearMatches.from_points(np.zeros((40, 2)), np.ones((40, 2)), image_size=(WIDTH, HEIGHT))
    shutter = RollingShutter(readout_s=0.03, exposure_s=EXPOSURE_S)
    with pytest.raises(ValueError, match="give a camera"):
        estimate_two_view(matches, shutter=shutter)


def test_a_turn_that_is_faster_down_the_rows_is_no_parallax_unless_the_shutter_is_global() -> None:
    """Untold, a rolling shutter is among the models; with --readout, also of 0, it is not."""
    for seed in range(3):
        scene = make_scene(np.random.default_rng(seed), count=400, length_px=15, rotation_share=np.inf)
        middle, half = scene.ends.mean(axis=1), 0.5 * (scene.ends[:, 1] - scene.ends[:, 0])
        half *= (1 + 0.4 * (middle[:, 1] / IMAGE_SIZE[1] - 0.5))[:, None]
        ends = np.stack([middle - half, middle + half], axis=1)
        ends += np.random.default_rng(seed).normal(0, 0.2, ends.shape)
        matches = SmearMatches(ends=ends, sigma_px=np.full(400, 0.4), image_size=IMAGE_SIZE)
        (f, _, x), (_, _, y), _ = scene.camera.K  # and of a picture that EXIF turned
        aside = Camera.from_opencv(np.array([[f, 0, y], [0, f, x], [0, 0, 1]]), None, IMAGE_SIZE[::-1])
        on_its_side = replace(matches, ends=ends[..., ::-1], image_size=IMAGE_SIZE[::-1])
        for one, camera in ((on_its_side, aside), (matches, scene.camera)):
            geometry = estimate_two_view(one, camera=camera)
            assert geometry.parallax is not Parallax.PROVEN
            assert geometry.config is Configuration.PANORAMIC
            turns = next(row for row in geometry.models if row.model == "rotation")
            assert turns.probability > 0.5 and turns.parameters == 6
        known = RollingShutter(readout_s=0.0, exposure_s=EXPOSURE_S)
        told = estimate_two_view(matches, camera=scene.camera, shutter=known)
        assert all(row.parameters == 3 for row in told.models if row.model == "rotation")


def test_deviations_shrink_as_the_smears_of_rows_that_were_seen_longer() -> None:
    shutter = RollingShutter(readout_s=0.02, exposure_s=EXPOSURE_S)
    ends = smears(scene(deep=False), shutter, 0.03 * ABOUT_X)
    matches = SmearMatches(ends=ends, sigma_px=np.full(COUNT, 0.5), across_px=np.full(COUNT, 0.2))
    there = shutter.all_rows_at_once(matches, np.zeros(COUNT, bool), (WIDTH, HEIGHT))
    assert there is not None
    share = there.length_px / matches.length_px
    assert np.abs(share - 1).min() > 0.01
    np.testing.assert_allclose([there.sigma_px, there.across_px], [0.5 * share, 0.2 * share])
