"""What moves must contradict every motion that the camera may have had."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.pipeline import Estimate
from blur2view.robust.independence import BLOCKS, cells
from blur2view.segmentation import admitted
from blur2view.segmentation.admitted import admitted_motions, least_score
from blur2view.segmentation.mask import MotionLabel, SegmentOptions, segment
from blur2view.segmentation.score import motion_score
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.options import EstimatorOptions
from tests.support.colour_code import EPIPOLE, forward_motion
from tests.support.motion_scenes import BOX, MOVER, SHIFT, SIDEWAYS, estimate_of

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


def test_what_the_homography_explains_is_no_mover_where_parallax_is_open() -> None:
    displacement = forward(moving=True)
    shift = np.array([[1, 0, MOVER[0]], [0, 1, MOVER[1]], [0, 0, 1.0]])
    alone = segment(estimate_of(displacement, F=RADIAL), options=SegmentOptions(splits=0))
    both = segment(estimate_of(displacement, F=RADIAL, H=shift), options=SegmentOptions(splits=0))
    assert (alone.labels == MotionLabel.MOVING).mean() > 0.05
    assert (both.labels != MotionLabel.MOVING).all()


def test_scores_are_the_least_and_none_without_any_motion() -> None:
    found = estimate_of(forward(moving=True), F=RADIAL)
    radial, sideways = found.geometry, replace(found.geometry, F=SIDEWAYS)
    own = motion_score(found)
    each = own, motion_score(replace(found, geometry=sideways), max(own.error_scale, 1.0))
    least = least_score(found, [radial, sideways])
    np.testing.assert_array_equal(least.score, np.minimum(each[0].score, each[1].score))
    np.testing.assert_array_equal(least.reach, np.minimum(each[0].reach, each[1].reach))
    unknown = least_score(found, [radial, replace(radial, F=None)])
    assert not unknown.score.any() and not unknown.reach.any() and "half of the picture" in unknown.reason


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
    believed = motion_score(replace(found, geometry=elsewhere))
    assert believed.error_scale > 2 and believed.score[30, 55] < 9  # its own errors would hide the mover
    assert least_score(found, [found.geometry, elsewhere]).score[30, 55] > 9
