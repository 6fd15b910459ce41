"""Motion masks: scores in closed form, parts where they are, and no mask where nothing is known."""

from dataclasses import replace

import numpy as np
import pytest
from blur2view.smears.selection import GridSmears, grid_pixels
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.sampson import serrmin
from blur2view.geometry.two_view_geometry import Configuration
from blur2view.segmentation import regions as motion_regions
from blur2view.segmentation import score as motion_score
from blur2view.segmentation.admitted import least_score
from blur2view.segmentation.mask import MotionLabel, MotionMask, SegmentOptions, moving_regions
from blur2view.smears.field import SmearField, smear_ends
from blur2view.visualization import mask_overlay
from tests.support.motion_scenes import (
    BOX,
    HEIGHT,
    MOVER,
    SHIFT,
    SIDEWAYS,
    STATIC_PX,
    SURE_RAD,
    WIDTH,
    by_scores,
    estimate_of,
    photo,
    sideways,
    with_mover,
)


def overlap(mask: MotionMask) -> float:
    true = np.zeros(mask.labels.shape, bool)
    true[BOX] = True
    moving = mask.labels == MotionLabel.MOVING
    return float((moving & true).sum() / (moving | true).sum())


def score_at(displacement: NDArray[np.float32], **told: object) -> motion_score.MotionScore:
    return motion_score.motion_score(estimate_of(displacement, **told))  # type: ignore[arg-type]


def test_score_of_a_smear_across_the_epipolar_lines_is_its_length_over_sigma() -> None:
    scored = score_at(with_mover(), F=SIDEWAYS)
    length = np.hypot(*MOVER)
    # the Sampson distance of both ends from one horizontal line between them is dy / sqrt 2
    sigma = np.hypot(length * SURE_RAD / 2**0.5, motion_score.FLOOR_PX)
    np.testing.assert_allclose(scored.score[30, 50], (MOVER[1] / 2**0.5 / sigma) ** 2, rtol=1e-6)
    np.testing.assert_allclose(scored.score[5, 5], 0, atol=1e-9)


def test_neither_signs_of_smears_nor_of_time_change_the_score() -> None:
    rng = np.random.default_rng(1)
    displacement = with_mover() + rng.normal(0, 1, (HEIGHT, WIDTH, 2)).astype(np.float32)
    F = SIDEWAYS + 1e-3 * rng.normal(size=(3, 3))
    signs = rng.choice([-1, 1], (HEIGHT, WIDTH, 1)).astype(np.float32)
    one = score_at(displacement, F=F)
    for other in (score_at(signs * displacement, F=F), score_at(displacement, F=F.T)):
        np.testing.assert_allclose(other.score, one.score, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(other.reach, one.reach, rtol=1e-6, atol=1e-9)


def test_noise_scale_is_that_of_the_photograph() -> None:
    rng = np.random.default_rng(2)
    turned = sideways()
    turned[..., 1] = rng.normal(0, 4 * SURE_RAD * STATIC_PX, (HEIGHT, WIDTH))  # four times the stated error
    found = estimate_of(turned, F=SIDEWAYS)
    scored = least_score(found, [found.geometry])
    plain = score_at(turned, F=SIDEWAYS, sigma_rad=4 * SURE_RAD)  # the same errors, stated
    assert np.mean(scored.score > motion_regions.HIGH) < 0.04
    np.testing.assert_allclose(np.median(scored.score), np.median(plain.score), rtol=0.2)


def test_nothing_is_told_at_the_epipole_nor_of_short_or_unsure_smears() -> None:
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    epipole = np.array([160.0, 120.0], np.float32)
    forward = 0.2 * (np.dstack([x, y]) - epipole)
    F = cross_matrix(np.array([*epipole, 1.0]))
    reach = score_at(forward, F=F).reach
    assert reach[30, 40] < motion_regions.HIGH < reach[5, 5]
    unsure = np.full((HEIGHT, WIDTH), SURE_RAD, np.float32)
    unsure[:, :80] = 1.5  # of a smear that may have any direction
    noisy = sideways()
    noisy[..., 1] = np.random.default_rng(0).normal(0, 4, (HEIGHT, WIDTH))
    reach = score_at(noisy, F=SIDEWAYS, sigma_rad=unsure).reach
    assert np.median(reach[:, :18]) < motion_regions.HIGH < np.median(reach[:, 22:])


def test_displacements_of_a_homography_join_ends_that_it_maps_on_each_other() -> None:
    angle, centre = 0.06, np.array([160.0, 120.0])
    c, s = np.cos(angle), np.sin(angle)
    H = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    H[:2, 2] = centre - H[:2, :2] @ centre
    points = np.random.default_rng(3).uniform(0, 200, (50, 2))
    d = motion_score.displacement_of(H, points)
    ends = smear_ends(points, d)
    mapped = ends[:, 0] @ H[:2, :2].T + H[:2, 2]
    assert np.abs(mapped - ends[:, 1]).max() < 0.01 * np.linalg.norm(d, axis=1).max()


def test_homography_explains_its_own_smears_and_not_others() -> None:
    mask = by_scores(estimate_of(with_mover(), H=SHIFT))
    assert overlap(mask) > 0.9 and "homography" in mask.reason


def test_before_a_still_camera_the_score_is_the_length() -> None:
    displacement = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    displacement[BOX] = MOVER
    found = estimate_of(displacement)
    scored = motion_score.motion_score(found)
    expected = (np.hypot(*MOVER) / motion_score.STILL_FLOOR_PX) ** 2
    np.testing.assert_allclose(scored.score[30, 50], expected, rtol=1e-6)
    mask = by_scores(found)
    assert overlap(mask) > 0.9 and "stands still" in mask.reason


def test_a_share_that_is_not_all_is_not_called_all() -> None:
    found = estimate_of(np.zeros((HEIGHT, WIDTH, 2), np.float32))
    still = replace(found, matches=replace(found.matches, still_share=0.998))
    assert "(99% of what can be measured" in motion_score.motion_score(still).reason


def test_without_any_motion_of_the_camera_to_measure_against_all_is_unobservable() -> None:
    mask = by_scores(estimate_of(sideways()))
    assert (mask.labels == MotionLabel.UNOBSERVABLE).all() and mask.regions == ()
    assert "told by the test" in mask.reason


def test_mover_is_found_where_it_is_and_described() -> None:
    mask = by_scores(estimate_of(with_mover(), F=SIDEWAYS))
    assert overlap(mask) > 0.95
    (region,) = mask.regions
    x, y, width, height = region.box
    assert abs(x - 180) <= 3 and abs(y - 80) <= 3 and abs(width - 90) <= 6 and abs(height - 80) <= 6
    np.testing.assert_allclose(region.centroid, (224.5, 119.5), atol=2)
    assert region.area_px == (mask.labels == MotionLabel.MOVING).sum()
    np.testing.assert_allclose(region.score, mask.score[mask.labels == MotionLabel.MOVING].mean(), rtol=1e-5)
    inside, outside = mask.probability[120, 225], mask.probability[20, 20]
    assert 0 <= outside < 0.1 < 0.55 < inside <= 1  # the evidence alone, at its cap, passes one half


def test_probability_is_above_one_half_where_the_mask_says_moving_and_nowhere_else() -> None:
    rng = np.random.default_rng(8)
    noise = rng.normal(0, 0.5, (HEIGHT, WIDTH, 2)).astype(np.float32)
    before_still = np.where(with_mover() == MOVER, with_mover(), 0)
    for found in (estimate_of(with_mover() + noise, F=SIDEWAYS), estimate_of(before_still + noise)):
        mask = by_scores(found)
        moving = mask.labels == MotionLabel.MOVING
        assert 0.05 < moving.mean() < 0.4
        np.testing.assert_array_equal(mask.probability > 0.5, moving)
        np.testing.assert_array_equal(np.round(255 * mask.probability) >= 128, moving)


def test_static_scene_has_no_moving_part() -> None:
    noisy = sideways()
    noisy += np.random.default_rng(4).normal(0, 0.5, noisy.shape).astype(np.float32)
    mask = by_scores(estimate_of(noisy, F=SIDEWAYS))
    assert (mask.labels == MotionLabel.STATIC).all()


def test_any_size_will_do() -> None:
    for shape in ((17, 16), (18, 203), (61, 35)):
        found = estimate_of(sideways(shape), F=SIDEWAYS)
        mask = by_scores(found)
        assert mask.labels.shape == mask.score.shape == mask.probability.shape == shape


def test_objects_have_a_motion_of_their_own() -> None:
    displacement = sideways()
    y, x = np.mgrid[BOX].astype(np.float32)
    own = np.dstack([0.05 * (x - 225), 0.25 * (y - 20)])  # stretched: away from a far epipole
    displacement[BOX] = own
    found = estimate_of(displacement, F=SIDEWAYS)
    assert all(region.F is None for region in by_scores(found).regions)
    (region,) = by_scores(found, SegmentOptions(objects=True)).regions
    assert region.reason and region.config in (Configuration.PLANAR, Configuration.PLANAR_OR_PANORAMIC)
    rows, columns = np.mgrid[100:140:5, 200:250:5]
    points = np.stack([columns.ravel(), rows.ravel()], axis=1)
    ends = smear_ends(points, displacement[rows, columns].reshape(-1, 2))
    assert region.H is not None  # the motion is affine
    errors = [
        motion_score.displacement_of(region.H, points) - sign * (ends[:, 1] - ends[:, 0]) for sign in (1, -1)
    ]
    assert min(np.median(np.linalg.norm(error, axis=1)) for error in errors) < 0.5
    if region.F is not None:
        assert np.median(serrmin(region.F, ends)) < 0.25 < np.median(serrmin(SIDEWAYS, ends))


def test_weak_parts_move_only_with_strong_ones() -> None:
    score = np.zeros((100, 120))
    score[10:40, 10:30] = 5.0  # weak alone
    score[60:90, 10:30] = 5.0
    score[60:70, 30:60] = 12.0  # strong, beside a weak one
    score[5, 100:110] = 30.0  # strong, but one cell wide
    moving = motion_regions.moving_parts(score)
    assert not moving[10:40, 10:30].any() and not moving[:10].any()
    assert moving[60:90, 10:30].all() and moving[60:70, 30:60].all()


def test_distorted_cameras_are_judged_by_undistorted_smears() -> None:
    from blur2view.camera.camera import Camera

    camera = Camera.from_string("SIMPLE_RADIAL 320 240 200 160 120 0.25")
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    grid = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    straight = camera.undistorted(grid)
    # each undistorted point moves along x; the inverse of the distortion by its Jacobian, which is smooth
    step = 0.5
    J = np.stack(
        [(camera.undistorted(grid + axis) - camera.undistorted(grid - axis)) / (2 * step)
         for axis in (np.array([step, 0]), np.array([0, step]))], axis=-1,
    )  # fmt: skip
    seen = np.linalg.solve(J, np.broadcast_to(np.array([STATIC_PX, 0.0])[:, None], (len(grid), 2, 1)))[..., 0]
    assert np.isfinite(straight).all()
    displacement = seen.reshape(HEIGHT, WIDTH, 2).astype(np.float32)
    found = estimate_of(displacement, F=SIDEWAYS)
    bent = motion_score.motion_score(found).score
    right = motion_score.motion_score(replace(found, camera=camera)).score
    assert np.quantile(right, 0.95) < 0.3 * np.quantile(bent, 0.95)


@pytest.mark.parametrize(("F", "H"), [(SIDEWAYS, None), (None, SHIFT)], ids="FH")
def test_smears_without_rays_of_a_distorted_camera_are_unobservable(F: Array | None, H: Array | None) -> None:
    from blur2view.camera.camera import Camera

    camera = Camera.from_string("SIMPLE_RADIAL 320 240 220 160 120 -0.35")
    displacement = sideways()
    displacement[:, :80] = MOVER
    found = replace(estimate_of(displacement, F=F, H=H), camera=camera)
    rows, columns = grid_pixels((HEIGHT, WIDTH))
    ends = smear_ends(np.stack([columns, rows], axis=1), displacement[rows, columns])
    scored = motion_score.motion_score(found)
    rays = np.isfinite(camera.undistorted(ends)).all(axis=(1, 2))
    blind = np.reshape(~rays, scored.score.shape)
    assert blind[0, 0] and 0.05 < blind.mean() < 0.4
    assert (scored.score[blind] == 0).all() and (scored.reach[blind] == 0).all()
    assert (scored.reach[~blind] > 0).all()
    labels = by_scores(found).labels
    assert (labels[:10, :10] == MotionLabel.UNOBSERVABLE).all() and labels[120, 40] == MotionLabel.MOVING


def test_overlay_is_pink_on_what_moves_and_refuses_another_size() -> None:
    mask, image = by_scores(estimate_of(with_mover(), F=SIDEWAYS)), photo()
    picture = mask_overlay.draw_motion(image, mask)
    canvas = picture[:480]
    np.testing.assert_allclose(canvas[20, 20], 255 * image[10, 10], atol=25)
    inside = canvas[240, 450].astype(int)
    expected = 0.45 * 255 * image[120, 225] + 0.55 * np.array(mask_overlay.PINK)
    np.testing.assert_allclose(inside, expected, atol=20)
    assert "1 moving part," in mask_overlay.headline(mask)
    with pytest.raises(ValueError, match="expected a mask of shape"):
        mask_overlay.draw_motion(image[:100, :100], mask)


def test_grid_shape_is_that_of_the_smears() -> None:
    for shape in ((1, 1), (4, 5), (6, 9), (240, 321)):
        field = SmearField(
            displacement=np.zeros((*shape, 2), np.float32), sigma_px=np.ones(shape, np.float32)
        )
        rows, columns = motion_score.grid_shape(shape)
        assert rows * columns == len(GridSmears.of(field).points)


def test_turned_smears_keep_midpoint_and_length_and_are_perpendicular() -> None:
    ends = np.random.default_rng(6).uniform(0, 100, (20, 2, 2))
    turned = motion_score.turned_ends(ends)
    d, t = ends[:, 1] - ends[:, 0], turned[:, 1] - turned[:, 0]
    np.testing.assert_allclose(turned.mean(axis=1), ends.mean(axis=1))
    np.testing.assert_allclose(np.linalg.norm(t, axis=1), np.linalg.norm(d, axis=1))
    np.testing.assert_allclose((d * t).sum(axis=1), 0, atol=1e-9)


def test_parts_are_described_by_their_own_pixels() -> None:
    moving = np.zeros((30, 40), bool)
    moving[2:5, 7] = moving[4, 3:8] = True  # its first pixel, row by row, is not at its left
    moving[20:28, 10:30] = True
    score = np.where(moving, 2.0, 0.0).astype(np.float32)
    score[20:28, 10:30] += np.arange(20, dtype=np.float32)
    large, small = moving_regions(moving, score)
    assert (large.area_px, small.area_px) == (160, 7)
    assert (large.box, small.box) == ((10, 20, 20, 8), (3, 2, 5, 3))
    assert (large.inside, small.inside) == ((10, 20), (7, 2))
    assert large.score == pytest.approx(2 + 9.5) and small.score == pytest.approx(2)
    assert small.of(moving).sum() == 7 and small.of(moving)[4, 3]
