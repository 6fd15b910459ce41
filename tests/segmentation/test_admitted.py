"""What moves must contradict every motion that the camera may have had."""

from dataclasses import replace

import numpy as np
import pytest
from blur2view.robust.independence import BLOCKS, cells
from numpy.typing import NDArray

from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.pipeline import Estimate
from blur2view.segmentation import admitted, mask
from blur2view.segmentation.admitted import admitted_motions, least_score
from blur2view.segmentation.mask import MotionLabel, SegmentOptions, segment
from blur2view.segmentation.regions import decide
from blur2view.segmentation.score import motion_score
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.options import EstimatorOptions
from tests.support.colour_code import EPIPOLE, forward_motion
from tests.support.motion_scenes import (
    BOX,
    HEIGHT,
    MOVER,
    SHIFT,
    SIDEWAYS,
    STATIC_PX,
    WIDTH,
    estimate_of,
    sideways,
    with_mover,
)

RADIAL = cross_matrix(np.array([*EPIPOLE, 1.0]))  # the F of `forward_motion`


def forward(moving: bool = False) -> NDArray[np.float32]:
    displacement = forward_motion().astype(np.float32)
    if moving:
        displacement[BOX] = MOVER
    return displacement


def noted_halves(monkeypatch: pytest.MonkeyPatch, found: Estimate) -> list[SmearMatches]:
    """Return the smears of both halves of each of two splits."""
    halves: list[SmearMatches] = []

    def noted(matches: SmearMatches, *_: object) -> TwoViewGeometry:
        halves.append(matches)
        return found.geometry

    monkeypatch.setattr(admitted, "estimate_two_view", noted)
    admitted_motions(found, 2, EstimatorOptions(), np.random.default_rng(0))
    return halves


@pytest.mark.parametrize("seed", range(4))
def test_a_near_thing_is_no_mover_if_halves_of_the_picture_see_parallax(seed: int) -> None:
    displacement = forward()
    displacement[BOX] *= 2.5
    zoom = np.diag([1.16, 1.16, 1.0])
    zoom[:2, 2] = -0.16 * EPIPOLE
    found = estimate_of(displacement, H=zoom)
    believed = segment(found, options=SegmentOptions(splits=0))
    assert (believed.labels[BOX] == MotionLabel.MOVING).mean() > 0.5
    checked = segment(found, rng=np.random.default_rng(seed))
    assert (checked.labels != MotionLabel.MOVING).all()


def test_a_mover_contradicts_the_halves_too() -> None:
    mask = segment(estimate_of(forward(moving=True), F=RADIAL))
    moving = mask.labels == MotionLabel.MOVING
    true = np.zeros(moving.shape, bool)
    true[BOX] = True
    assert (moving & true).sum() / (moving | true).sum() > 0.8


def test_each_smear_is_in_one_half_of_every_split(monkeypatch: pytest.MonkeyPatch) -> None:
    found = estimate_of(forward(), F=RADIAL, H=SHIFT)
    halves = noted_halves(monkeypatch, found)
    assert len(halves) == 4
    block = cells(found.matches.midpoint, BLOCKS)
    for one, other in (halves[:2], halves[2:]):
        assert len(one) + len(other) == len(found.matches)
        inside = (found.matches.ends[:, None] == one.ends).all(axis=(2, 3)).any(axis=1)
        first, second = set(block[inside]), set(block[~inside])
        assert first.isdisjoint(second) and first and second


def test_each_sure_smear_is_in_the_half_of_its_block(monkeypatch: pytest.MonkeyPatch) -> None:
    found = estimate_of(forward(), F=RADIAL)
    found = replace(found, matches=replace(found.matches, sure_ends=found.matches.ends))
    halves = noted_halves(monkeypatch, found)
    assert len(halves) == 4
    for half in halves:
        assert half.sure_ends is not None and 0 < len(half) < len(found.matches)
        np.testing.assert_array_equal(half.sure_ends, half.ends)


def two_motions() -> tuple[Estimate, list[TwoViewGeometry]]:
    """Return unsure smears, which two F explain alike, and a box of sure ones, which only the second does."""
    rng = np.random.default_rng(0)
    displacement = sideways()
    displacement[..., 1] = rng.normal(0, STATIC_PX, displacement.shape[:2])
    displacement[BOX] = MOVER
    sigma_rad = np.ones(displacement.shape[:2], np.float32)
    sigma_rad[BOX] = 0.05
    found = estimate_of(displacement, F=SIDEWAYS, sigma_rad=sigma_rad)
    along_the_box = cross_matrix(np.array([*MOVER, 0.0])) / np.hypot(*MOVER)
    return found, [found.geometry, replace(found.geometry, F=along_the_box)]


@pytest.mark.parametrize("sigma_px", [1.0, 2.0])
def test_a_homography_that_errs_as_stated_is_admitted_beside_F(sigma_px: float) -> None:
    displacement = sideways()
    displacement[BOX] *= 2.0  # along the lines of F, but not by H
    rng = np.random.default_rng(0)
    noise = np.repeat(np.repeat(rng.normal(0, 0.5**0.5 * sigma_px, (30, 40, 2)), 8, 0), 8, 1)
    noisy = (displacement + noise).astype(np.float32)
    angle = 0.5**0.5 * sigma_px / STATIC_PX
    found = estimate_of(noisy, F=SIDEWAYS, H=SHIFT, sigma_px=sigma_px, sigma_rad=angle)
    scored = least_score(found, [replace(found.geometry, H=None), replace(found.geometry, F=None)])
    assert scored.greatest[30, 55] > 4 * scored.score[30, 55]


def test_what_one_of_two_motions_explains_is_unobservable() -> None:
    found, motions = two_motions()
    inside = tuple(slice(side.start // 4, side.stop // 4) for side in BOX)
    alone, both = (decide(least_score(found, some)) for some in (motions[:1], motions))
    assert alone.moving[inside].mean() > 0.9
    assert not both.moving[inside].any() and not both.observable[inside].any()


def test_scores_are_the_least_and_the_greatest_and_none_without_any_motion() -> None:
    found, motions = two_motions()
    each = [motion_score(replace(found, geometry=one)) for one in motions]
    scale = max(1.0, min(one.error_scale for one in each))
    both = least_score(found, motions)
    np.testing.assert_allclose(both.score * scale**2, np.minimum(each[0].score, each[1].score))
    np.testing.assert_allclose(both.greatest * scale**2, np.maximum(each[0].score, each[1].score))
    np.testing.assert_allclose(both.reach * scale**2, np.minimum(each[0].reach, each[1].reach))
    unknown = least_score(found, [motions[0], replace(motions[0], F=None)])
    assert not unknown.score.any() and not unknown.reach.any() and "half of the picture" in unknown.reason


def test_masks_are_of_the_smears_as_recorded_whatever_the_shutter(monkeypatch: pytest.MonkeyPatch) -> None:
    found = estimate_of(with_mover(), F=SIDEWAYS)
    corrected = replace(found.geometry, F=cross_matrix(np.array([0.0, 1.0, 0.0])) / 2**0.5)
    shutter = RollingShutter(readout_s=0.03, exposure_s=0.02)
    monkeypatch.setattr(mask, "estimate_two_view", lambda *_: found.geometry)
    options = SegmentOptions(splits=0, objects=False)
    plain = segment(found, options)
    shut = segment(replace(found, geometry=corrected, shutter=shutter), options)
    np.testing.assert_array_equal(shut.labels, plain.labels)


@pytest.mark.parametrize("turn", [(0.0, 0.05, 0.0), (0.05, 0.0, 0.0), (0.0, 0.0, 0.12), (0.04, 0.0, 0.1)])
def test_a_rolling_shutter_alone_moves_nothing(turn: tuple[float, float, float]) -> None:
    focal, share = 300.0, 2.0 / HEIGHT  # a readout of two exposure times
    x, y = (np.indices((HEIGHT, WIDTH))[::-1] - np.array([[[WIDTH / 2]], [[HEIGHT / 2]]])) / focal
    u = turn[1] * (1 + x**2) - turn[0] * x * y - turn[2] * y
    v = turn[2] * x - turn[0] * (1 + y**2) + turn[1] * x * y
    at_once = focal * np.stack([u, v], axis=-1)
    recorded = (at_once / (1 - share * at_once[..., 1:])).astype(np.float32)
    angles = (0.7 / np.maximum(np.hypot(*recorded.transpose(2, 0, 1)), 1)).astype(np.float32)
    found = estimate_of(recorded, sigma_rad=angles)
    found = replace(found, geometry=estimate_two_view(found.matches))
    labels = segment(found).labels
    assert (labels == MotionLabel.MOVING).mean() < 0.02 and (labels == MotionLabel.STATIC).mean() > 0.5


def test_same_generator_same_mask_and_splits_are_not_negative() -> None:
    found = estimate_of(forward(moving=True), F=RADIAL)
    one, other = (segment(found, rng=np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one.labels, other.labels)
    np.testing.assert_array_equal(one.score, other.score)
    with pytest.raises(ValueError, match="splits"):
        SegmentOptions(splits=-1)


def test_a_motion_that_explains_little_explains_no_mover() -> None:
    found = estimate_of(forward(moving=True), F=RADIAL)
    elsewhere = replace(found.geometry, F=SIDEWAYS)
    alone = least_score(found, [elsewhere])
    assert alone.error_scale > 2 and alone.score[30, 55] < 9  # its own errors hide the mover
    assert least_score(found, [found.geometry, elsewhere]).score[30, 55] > 9


def test_a_half_that_fits_the_mover_at_the_cost_of_the_rest_is_not_admitted() -> None:
    noise = np.random.default_rng(0).normal(0, 0.1, (240, 320, 2)).astype(np.float32)
    found = estimate_of(with_mover() + noise, F=SIDEWAYS)
    tilted = cross_matrix(
        np.array([1.0, 0.1, 0.0])
    )  # off by 0.8 px in the whole picture, twice the stated error
    motions = [found.geometry, replace(found.geometry, F=tilted)]
    alone, both = (least_score(found, some) for some in (motions[:1], motions))
    np.testing.assert_array_equal(both.score, alone.score)
    np.testing.assert_array_equal(both.greatest, alone.greatest)
