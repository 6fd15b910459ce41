"""What is told of smears: in closed form, mirrored with the photograph, finite wherever nothing is known."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ive

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.geometry.epipolar import cross_matrix
from blur2view.pipeline import Estimate
from blur2view.segmentation.features import (
    CHANNELS,
    LENGTH_UNIT,
    LONGEST_SCORE,
    TURNS,
    cell_pixels,
    directions_of_F,
    doubled,
    motion_features,
)
from blur2view.segmentation.score import measured_ends, motion_score
from blur2view.smears.field import SmearField, to_double_angle
from blur2view.smears.sampling import GridSmears, grid_pixels
from tests.support.motion_scenes import (
    HEIGHT,
    SHIFT,
    SIDEWAYS,
    STATIC_PX,
    SURE_RAD,
    WIDTH,
    estimate_of,
    sideways,
)

SHAPE = (48, 64)
Features = NDArray[np.float32]


def told(found: Estimate) -> Features:
    return motion_features(found, motion_score(found))


def cells_of(values: Array, side: int = 4) -> Features:
    """Repeat values (h, w, ...) over cells of a field."""
    return np.repeat(np.repeat(values, side, 0), side, 1).astype(np.float32)


def random_smears(seed: int, shape: tuple[int, int] = SHAPE, side: int = 4) -> dict[str, Features]:
    """Give smears of any direction and length, one for every cell, and their sigmas."""
    rng = np.random.default_rng(seed)
    grid = shape[0] // side, shape[1] // side
    return {
        "displacement": cells_of(rng.normal(0, 8, (*grid, 2)), side),
        "sigma_px": cells_of(rng.uniform(0.5, 4, grid), side),
        "sigma_rad": cells_of(rng.uniform(0.01, 0.8, grid), side),
    }


def estimated(smears: dict[str, Features], F: Array | None = None, H: Array | None = None) -> Estimate:
    return estimate_of(smears["displacement"], F, H, smears["sigma_px"], smears["sigma_rad"])


def random_F(seed: int) -> Array:
    """Give an F of rank 2 that sees rotation and has its epipoles near the picture."""
    rng = np.random.default_rng(seed)
    H = np.eye(3) + rng.normal(0, 0.02, (3, 3)) * [[1, 1, 99], [1, 1, 99], [1e-2, 1e-2, 0]]
    F: Array = cross_matrix(np.array([90.0, 10.0, 1.0])) @ H
    return F


H = np.array([[1.02, 0.05, 3.0], [-0.04, 0.99, -5.0], [1e-4, -2e-4, 1.0]])


@pytest.mark.parametrize("length", [0.0, 1.0, 3.0, 8.0, 12.0])
def test_sharpness_of_parallel_epipolar_lines_is_a_ratio_of_bessel_functions(length: float) -> None:
    features = told(estimate_of(sideways() * np.float32(length / STATIC_PX), F=SIDEWAYS))
    # the density exp(-half^2 sin^2 phi) of directions phi is von Mises' in double angle
    kappa = max(length / 2, 1.0) ** 2 / 2
    np.testing.assert_allclose(features[0], ive(1, kappa) / ive(0, kappa), rtol=1e-5)
    np.testing.assert_allclose(features[1], 0, atol=1e-6)


def test_long_smears_have_one_direction_and_those_at_the_epipole_any() -> None:
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    forward = np.float32(0.3) * (np.dstack([x, y]) - np.array([161, 121], np.float32))
    features = told(estimate_of(forward, F=cross_matrix(np.array([161.0, 121.0, 1.0]))))
    sharpness = np.hypot(features[0], features[1])
    radius = np.hypot(x - 161, y - 121)[1::4, 1::4]
    assert sharpness[30, 40] < 1e-6 and sharpness[radius < 6].max() < 0.3
    assert sharpness[radius > 100].min() > 0.99 and sharpness.max() < 1 + 1e-6
    np.testing.assert_allclose(features[2, radius > 20], 1, atol=5e-3)  # all run as predicted
    outward = to_double_angle(forward[1::4, 1::4] / np.maximum(0.3 * radius, 1)[..., None])
    found, far = np.moveaxis(features[:2], 0, -1) / np.maximum(sharpness, 0.1)[..., None], radius > 20
    np.testing.assert_allclose(found[far], outward[far], atol=0.1)  # 24 directions are tried


@pytest.mark.parametrize("length", [30.0, 200.0, 3000.0])
def test_direction_of_a_long_smear_is_the_nearest_that_was_tried(length: float) -> None:
    middle = np.array([[100.0, 80.0]])
    ends = np.stack([middle, middle + [[length, 0]]], axis=1)
    for off_deg, step in ((3.0, 0), (5.0, 1), (93.0, 12)):
        angle = np.deg2rad(off_deg)
        found = directions_of_F(cross_matrix(np.array([np.cos(angle), np.sin(angle), 0.0])), ends)
        nearest = np.exp(2j * np.pi * step / TURNS)
        assert abs(found[0] - nearest) < (0.2 if length < 100 else 1e-6)


@pytest.mark.parametrize("turn_deg", [0, 20, 45, 90, 150])
def test_smears_are_told_by_their_angle_to_the_predicted_direction(turn_deg: float) -> None:
    turn, smears = np.deg2rad(turn_deg), sideways(SHAPE)
    smears[:] = STATIC_PX * np.array([np.cos(turn), np.sin(turn)])
    for camera_deg in (0, 30):
        back = np.deg2rad(camera_deg)
        F = cross_matrix(np.array([np.cos(back), np.sin(back), 0.0]))
        features = told(estimate_of(smears, F=F))
        np.testing.assert_allclose(features[2], np.cos(2 * (turn - back)), atol=1e-4)
        np.testing.assert_allclose(features[3], np.sin(2 * (turn - back)), atol=1e-4)


def test_lengths_sigmas_and_scores_are_told_on_their_scales() -> None:
    smears = random_smears(0)
    found = estimated(smears, F=random_F(0))
    plain = motion_score(found)
    scored = replace(plain, score=9 * plain.score)
    features = motion_features(found, scored)
    at = slice(1, None, 4)
    length = np.hypot(*np.moveaxis(smears["displacement"][at, at], -1, 0))
    np.testing.assert_allclose(features[4], np.log1p(length) / LENGTH_UNIT, rtol=1e-5)
    np.testing.assert_allclose(features[5], np.log(smears["sigma_px"][at, at]) / LENGTH_UNIT, atol=1e-6)
    np.testing.assert_allclose(features[6], np.log(smears["sigma_rad"][at, at]) / LENGTH_UNIT, atol=1e-6)
    assert scored.score.max() > LONGEST_SCORE**2 > np.median(scored.score) > 0
    for channel, value in ((7, scored.score), (8, scored.reach)):
        np.testing.assert_allclose(
            features[channel], np.minimum(value**0.5, LONGEST_SCORE) / LENGTH_UNIT, rtol=1e-5
        )
    np.testing.assert_array_equal(features[9:12, 0, 0], [1, 0, 0])
    assert features.shape == (CHANNELS, 12, 16) and features.dtype == np.float32
    assert (features[9:] == features[9:, :1, :1]).all() and not features[12].any()


def test_network_without_sigmas_of_directions_is_told_as_one_that_knows_none() -> None:
    found = estimate_of(sideways(SHAPE), F=SIDEWAYS)
    field = SmearField(displacement=found.field.displacement, sigma_px=found.field.sigma_px)
    features = told(replace(found, field=field))
    np.testing.assert_allclose(features[6], np.log(np.pi / 2) / LENGTH_UNIT, rtol=1e-6)


def test_homography_predicts_direction_and_length() -> None:
    found = estimate_of(sideways(SHAPE), H=SHIFT)
    np.testing.assert_array_equal(told(found)[9:12, 3, 4], [0, 1, 0])
    np.testing.assert_allclose(told(found)[:2, 3, 4], [STATIC_PX / (1 + STATIC_PX), 0], atol=1e-6)
    np.testing.assert_allclose(told(found)[2:4, 3, 4], [1, 0], atol=1e-6)
    np.testing.assert_allclose(told(found)[12], np.log1p(STATIC_PX) / LENGTH_UNIT, rtol=1e-6)


def test_camera_without_a_motion_predicts_no_direction() -> None:
    smears = sideways(SHAPE)
    features = told(estimate_of(smears))
    assert not features[:4].any() and not features[7:11].any() and not features[12].any()
    assert (features[11] == 1).all()
    np.testing.assert_allclose(features[4], np.log1p(STATIC_PX) / LENGTH_UNIT, rtol=1e-6)
    smears[8:] = 0
    still = estimate_of(smears)
    assert motion_score(still).still
    assert not told(still)[:4].any() and (told(still)[11] == 1).all() and told(still)[7].any()


def test_neither_signs_of_smears_nor_of_time_change_what_is_told() -> None:
    smears, F = random_smears(1), random_F(1)
    signs = np.random.default_rng(1).choice([-1, 1], (*SHAPE, 1)).astype(np.float32)
    one = told(estimated(smears, F=F))
    assert 0.1 < np.median(np.hypot(one[0], one[1])) < 0.95
    flipped = smears | {"displacement": signs * smears["displacement"]}
    for other in (estimated(flipped, F=F), estimated(smears, F=F.T), estimated(smears, F=-3 * F)):
        np.testing.assert_allclose(told(other), one, rtol=1e-5, atol=1e-6)


@pytest.mark.train
@pytest.mark.parametrize("kind", ["F", "H", "still"])
@pytest.mark.parametrize("way", ["left and right", "up and down", "x and y"])
def test_training_mirrors_features_as_a_mirrored_photograph_has_them(kind: str, way: str) -> None:
    training = pytest.importorskip("tools.training.train_motion", reason="needs torch")
    smears = random_smears(2)
    if kind == "still":
        smears["displacement"][:, :48] *= 0.01
    F, model = random_F(2) if kind == "F" else None, H if kind == "H" else None
    features = told(estimated(smears, F, model))
    blank = np.zeros((*SHAPE, 3), np.uint8), features, np.zeros((12, 16), np.uint8)
    height, width = SHAPE  # cells are sampled at pixels 1, 5, ... side - 3, which a mirror maps on each other
    if way == "x and y":
        M, expected = np.eye(3)[[1, 0, 2]], training.transposed(*blank)[1]
        other = {name: np.swapaxes(value, 0, 1) for name, value in smears.items()}
    elif way == "left and right":
        M, expected = np.array([[-1, 0, width - 2], [0, 1, 0], [0, 0, 1.0]]), training.mirrored(*blank, 1)[1]
        other = {name: np.flip(value, 1) for name, value in smears.items()}
    else:
        M, expected = np.array([[1, 0, 0], [0, -1, height - 2], [0, 0, 1.0]]), training.mirrored(*blank, 0)[1]
        other = {name: np.flip(value, 0) for name, value in smears.items()}
    other["displacement"] = other["displacement"] @ M[:2, :2].astype(np.float32)
    F, model = (None if F is None else M.T @ F @ M), (None if model is None else M @ model @ M)  # M M = 1
    np.testing.assert_allclose(told(estimated(other, F, model)), expected, rtol=1e-4, atol=1e-5)
    assert expected.shape != features.shape or np.abs(expected - features).max() > 0.5


@pytest.mark.parametrize("side", [1, 2, 5, 17, 457, 641, 2000])
def test_cells_are_sampled_at_their_centres(side: int) -> None:
    np.testing.assert_array_equal(cell_pixels(side), np.minimum(np.arange(0, side, 4) + 1, side - 1))


@pytest.mark.parametrize("shape", [(1, 1), (17, 18), (5, 457), (4, 3)])
@pytest.mark.parametrize(("F", "model"), [(SIDEWAYS, None), (None, SHIFT), (None, None)])
def test_any_size_will_do(shape: tuple[int, int], F: Array | None, model: Array | None) -> None:
    found = estimate_of(sideways(shape), F=F, H=model)
    features, cells = told(found), tuple(-(-side // 4) for side in shape)
    assert features.shape == (CHANNELS, *cells) and np.isfinite(features).all()


@pytest.mark.parametrize(("F", "model"), [(SIDEWAYS, None), (None, SHIFT)], ids="FH")
def test_smears_without_rays_of_a_distorted_camera_have_no_predicted_direction(
    F: Array | None, model: Array | None
) -> None:
    camera = Camera.from_string("SIMPLE_RADIAL 320 240 220 160 120 -0.35")
    found = replace(estimate_of(sideways(), F=F, H=model), camera=camera)
    rows, columns = grid_pixels((HEIGHT, WIDTH))
    ends = measured_ends(GridSmears.at(found.field, rows, columns), camera)
    blind = ~np.isfinite(ends).all(axis=(1, 2)).reshape(60, 80)
    assert blind[0, 0] and 0.05 < blind.mean() < 0.5
    features = told(found)
    assert np.isfinite(features).all()
    assert not features[:4, blind].any() and (np.hypot(*features[:2])[~blind] > 0.2).all()
    np.testing.assert_allclose(features[6, blind], np.log(SURE_RAD) / LENGTH_UNIT, rtol=1e-5)


def test_directions_ignore_the_smears_own_and_turn_with_the_picture() -> None:
    rng = np.random.default_rng(4)
    middle, half, F = rng.uniform(0, 60, (50, 2)), rng.uniform(1, 9, (50, 1)), random_F(4)
    ways = [np.stack([np.cos(a), np.sin(a)], 1) for a in rng.uniform(0, np.pi, (2, 50))]
    one, other = (directions_of_F(F, np.stack([middle - half * v, middle + half * v], 1)) for v in ways)
    np.testing.assert_allclose(one, other, atol=1e-9)
    R = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])  # 90 degrees: the tried directions stay the same
    turned = np.stack([middle - half * ways[0], middle + half * ways[0]], 1) @ R[:2, :2].T
    np.testing.assert_allclose(directions_of_F(R @ F @ R.T, turned), -one, atol=1e-9)


def test_double_angle_is_that_of_the_package() -> None:
    d = np.random.default_rng(5).normal(0, 5, (20, 2))
    expected = to_double_angle(d / np.linalg.norm(d, axis=1, keepdims=True))
    np.testing.assert_allclose(np.stack([doubled(d).real, doubled(d).imag], 1), expected, atol=1e-12)
    assert doubled(np.zeros((1, 2)))[0] == 0
