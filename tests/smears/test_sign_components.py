"""Sign components: relative orders on synthetic scenes, and what must not be joined."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.metrics import rho
from blur2view.robust.minimal_solvers import ALL_SIGNS, solve_seven_smears
from blur2view.smears.matches import SmearMatches
from blur2view.smears.sign_components import (
    SignComponents,
    no_components,
    sample_patterns,
    sign_components,
)
from blur2view.smears.sign_graph import near_pairs
from blur2view.two_view.estimate import estimate_two_view
from tests.support.scenes import IMAGE_SIZE, Scene, disturb, make_scene, project_smears, with_outliers

SEEDS = range(10)


def matches_of(ends: Array) -> SmearMatches:
    return SmearMatches(ends=ends, sigma_px=np.ones(len(ends)), image_size=IMAGE_SIZE)


def wrong_share(components: SignComponents, scene: Scene) -> float:
    """Share of the inliers whose order contradicts that of the majority of their component."""
    product = components.sign * np.where(scene.swapped, -1.0, 1.0)
    inlier = ~scene.outlier
    net = np.abs(np.bincount(components.label[inlier], weights=product[inlier]))
    return float(0.5 * (inlier.sum() - net.sum()) / inlier.sum())


def noisy(seed: int, outliers: float = 0.0, deg: float = 0.0, noise_px: float = 0.0, **scene: Any) -> Scene:
    rng = np.random.default_rng(seed)
    made = make_scene(rng, length_px=20.0, **scene)
    disturbed = disturb(made, rng, direction_deg=deg, length_share=0.15 * (deg > 0), noise_px=noise_px)
    return with_outliers(disturbed, rng, outliers) if outliers else disturbed


def patterns(components: SignComponents, inlier: Array, rng: np.random.Generator) -> float:
    """Median number of patterns of seven inliers."""
    index = np.flatnonzero(inlier)
    samples = np.stack([rng.choice(index, 7, replace=False) for _ in range(200)])
    return float(np.median(2.0 ** (components.touched(samples) - 1)))


@pytest.mark.parametrize(
    ("disturbance", "most_patterns"),
    [
        ({}, 2),
        ({"deg": 8.0}, 2),
        ({"noise_px": 1.0, "outliers": 0.3}, 4),
        ({"deg": 8.0, "noise_px": 1.0, "outliers": 0.5}, 8),
        ({"noise_px": 1.0, "outliers": 0.7}, 64),
    ],
)
def test_relative_orders_are_right_and_patterns_few(
    disturbance: dict[str, float], most_patterns: float
) -> None:
    wrong, left = [], []
    for seed in SEEDS:
        scene = noisy(seed, **disturbance)
        components = sign_components(matches_of(scene.ends))
        wrong.append(wrong_share(components, scene))
        left.append(patterns(components, ~scene.outlier, np.random.default_rng(0)))
    assert np.median(wrong) < 1e-3
    assert np.mean(wrong) < 0.01
    assert np.median(left) <= most_patterns


def test_most_outliers_stay_alone() -> None:
    for seed in SEEDS:
        scene = noisy(seed, outliers=0.5, noise_px=1.0)
        components = sign_components(matches_of(scene.ends))
        assert (components.sizes[components.label[scene.outlier]] == 1).mean() > 0.75


def test_scattered_depth_is_grouped_little_rather_than_wrongly() -> None:
    """Depth of its own for every point: no surface, so no neighbour says much."""
    wrong = []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        scene = make_scene(rng, length_px=20.0, rotation_share=1.0)
        points = rng.uniform(0, 1, (2000, 2)) * np.array(IMAGE_SIZE)
        depth = np.exp(rng.uniform(np.log(1.5), np.log(12), 2000))
        ends = project_smears(scene.K, scene.R, scene.t, points, depth)
        ends[scene.swapped] = ends[scene.swapped, ::-1]
        scattered = replace(scene, ends=ends, true_ends=ends)
        wrong.append(wrong_share(sign_components(matches_of(ends)), scattered))
    assert np.mean(wrong) < 0.01


def opposite_layers(rng: np.random.Generator, outliers: float) -> tuple[Array, np.ndarray]:
    """Give a square moving 20 px right before a background moving 6 left, noise and outliers on both."""
    middle = rng.uniform(0, 1, (2000, 2)) * np.array(IMAGE_SIZE)
    inside = (np.abs(middle - [320, 240]) < 120).all(axis=1)
    d = np.where(inside[:, None], [20.0, 0.0], [-6.0, 0.0]) + rng.normal(0, 1.0, (2000, 2))
    random = rng.random(2000) < outliers
    angle, length = rng.uniform(0, 2 * np.pi, 2000), rng.uniform(5, 25, 2000)
    d[random] = (length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))[random]
    ends = np.stack([middle - d / 2, middle + d / 2], axis=1)
    return ends, np.where(random, 2, inside)


@pytest.mark.parametrize("outliers", [0.0, 0.3, 0.6])
def test_outliers_do_not_chain_layers_that_move_oppositely(outliers: float) -> None:
    for seed in SEEDS:
        ends, layer = opposite_layers(np.random.default_rng(seed), outliers)
        label = sign_components(matches_of(ends)).label
        near, far = (np.bincount(label[layer == which], minlength=len(label)) for which in (1, 0))
        assert (np.minimum(near, far) <= 0.03 * (layer < 2).sum()).all()


def test_sides_of_a_motion_that_passes_through_zero_are_parted() -> None:
    """To the left all moves left, to the right right, and a network never says zero."""
    middle = np.random.default_rng(0).uniform(0, 1, (2000, 2)) * np.array(IMAGE_SIZE)
    across = middle[:, 0] - 320
    d = np.stack([np.hypot(across / 16, 3.0), np.zeros(2000)], axis=1)
    label = sign_components(matches_of(np.stack([middle - d / 2, middle + d / 2], axis=1))).label
    assert set(label[across < -160]).isdisjoint(label[across > 160])
    assert np.bincount(label[across < -160]).max() > 0.9 * (across < -160).sum()


def test_swapping_the_ends_of_a_smear_flips_its_sign_alone() -> None:
    scene = noisy(0, outliers=0.2, noise_px=1.0)
    swap = np.random.default_rng(1).random(2000) < 0.5
    ends = scene.ends.copy()
    ends[swap] = ends[swap, ::-1]
    one, other = sign_components(matches_of(scene.ends)), sign_components(matches_of(ends))
    assert (one.label == other.label).all()
    ratio = one.sign * other.sign * np.where(swap, -1, 1)
    same = np.bincount(one.label, weights=ratio)
    assert (np.abs(same) == one.sizes).all()


def test_components_follow_a_similarity_of_the_coordinates() -> None:
    scene = noisy(2)
    one = sign_components(matches_of(scene.ends))
    other = sign_components(matches_of(scene.ends * 3.0 + 100.0))
    assert (one.label == other.label).mean() > 0.999


def test_a_field_that_turns_half_round_a_point_is_split_where_it_contradicts_itself() -> None:
    """Direction = half the polar angle: no orientation of the whole field is consistent."""
    middle = np.random.default_rng(0).uniform(0, 1, (2000, 2)) * np.array(IMAGE_SIZE)
    polar = np.arctan2(*(middle - [320, 240]).T[::-1])
    half = 6.0 * np.stack([np.cos(polar / 2), np.sin(polar / 2)], axis=1)
    matches = matches_of(np.stack([middle - half, middle + half], axis=1))
    components = sign_components(matches)
    near, _ = near_pairs(middle, 8)
    inside = components.label[near[0]] == components.label[near[1]]
    oriented = matches.displacement * components.sign[:, None]
    dot = (oriented[near[0]] * oriented[near[1]]).sum(axis=1)[inside]
    assert inside.mean() > 0.5
    far = np.hypot(*(middle - [320, 240]).T)[near[0]][inside] > 60
    assert (dot[far] > 0).all()


def wrong_grouping(scene: Scene, kind: str) -> SignComponents:
    """Put all smears in one component whose signs are wrong, in the left half or at random."""
    count, rng = len(scene.swapped), np.random.default_rng(0)
    true = np.where(scene.swapped, -1.0, 1.0)
    wrong = {
        "left half": scene.ends[:, :, 0].mean(axis=1) < IMAGE_SIZE[0] / 2,
        "random": rng.random(count) < 0.5,
    }[kind]
    return SignComponents(label=np.zeros(count, int), sign=np.where(wrong, -true, true))


@pytest.mark.slow
@pytest.mark.parametrize("camera", [True, False])
def test_a_wrong_grouping_costs_the_estimate_nothing(monkeypatch: pytest.MonkeyPatch, camera: bool) -> None:
    """Geometric means of median rho over 10 scenes, 1 px of noise, 30 % outliers: as found and wrong."""
    values: dict[str, list[float]] = {"found": [], "left half": [], "random": []}
    for seed in SEEDS:
        scene = noisy(seed, outliers=0.3, noise_px=1.0, count=800)
        matches = replace(matches_of(scene.ends), image_size=IMAGE_SIZE if camera else None)
        for kind, results in values.items():
            given = sign_components(matches) if kind == "found" else wrong_grouping(scene, kind)
            monkeypatch.setattr("blur2view.two_view.search.sign_components", lambda _, given=given: given)
            F = estimate_two_view(matches).F
            results.append(1.0 if F is None else float(np.median(rho(F, scene.true_ends))))
    found, *wrong = (np.exp(np.mean(np.log(results))) for results in values.values())
    assert max(values["left half"] + values["random"]) < 0.05
    assert max(wrong) < 1.25 * found  # 1.3 where every sample trusts its components


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_few_smears_are_no_trouble(count: int) -> None:
    ends = np.random.default_rng(0).uniform(0, 100, (count, 2, 2))
    components = sign_components(matches_of(ends))
    assert len(components) == count
    assert components.count <= count


def test_smears_in_one_place_or_without_length_are_no_trouble() -> None:
    rng = np.random.default_rng(0)
    still = rng.uniform(0, 500, (300, 1, 2)).repeat(2, axis=1)
    assert sign_components(matches_of(still)).count == 300
    one_place = np.stack([-rng.normal(size=(300, 2)), np.zeros((300, 2))], axis=1)
    one_place[:, 1] = -one_place[:, 0]
    assert len(sign_components(matches_of(one_place))) == 300
    assert len(sign_components(matches_of(np.zeros((300, 2, 2))))) == 300
    column = np.stack([np.zeros(300), np.arange(300.0)], axis=1)
    moved = matches_of(np.stack([column, column + [3.0, 0.0]], axis=1))
    assert sign_components(moved).count == 1


def test_crowded_points_have_bounded_pairs() -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.normal(0, 0.01, (1500, 2)), rng.uniform(0, 500, (500, 2))])
    pairs, _ = near_pairs(points, 16)
    assert pairs.shape[1] <= 2000 * 16
    assert (pairs[0] < pairs[1]).all()


def test_touched_counts_and_subset_relabels() -> None:
    components = SignComponents(label=np.array([0, 0, 0, 1, 1, 2]), sign=np.array([1.0, -1, 1, 1, 1, 1]))
    assert components.count == 3
    assert components.sizes.tolist() == [3, 2, 1]
    assert components.touched(np.array([[0, 1, 2], [0, 3, 5], [3, 4, 5]])).tolist() == [1, 3, 2]
    part = components.subset(np.array([3, 4, 5]))
    assert part.label.tolist() == [0, 0, 1]
    assert no_components(3).count == 3


def test_samples_get_the_patterns_that_their_components_leave() -> None:
    components = SignComponents(
        label=np.array([0, 0, 0, 0, 0, 0, 0, 1, 1, 2]), sign=np.array([1.0, -1, 1, 1, 1, -1, 1, 1, -1, 1])
    )
    drawn = np.array([[0, 1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 7, 8], [9, 1, 2, 3, 8, 7, 6]])
    one, two, four = sample_patterns(components, drawn)
    assert [group.index.tolist() for group in (one, two, four)] == [[0], [1], [2]]
    assert one.signs.tolist() == [[[1.0, -1, 1, 1, 1, -1, 1]]]
    assert two.signs.tolist() == [[[1.0, -1, -1, -1, 1, -1, 1], [1.0, -1, -1, -1, 1, 1, -1]]]
    assert four.signs.shape == (1, 4, 7)
    assert (four.signs[0, :, 1] == -four.signs[0, :, 2]).all()
    assert (four.signs[0, :, 4] == -four.signs[0, :, 5]).all()
    assert len(np.unique(four.signs[0], axis=0)) == 4


def test_without_components_all_patterns_are_left() -> None:
    (group,) = sample_patterns(no_components(20), np.arange(14).reshape(2, 7))
    for signs in group.signs:
        assert (np.unique(signs, axis=0) == np.unique(ALL_SIGNS, axis=0)).all()
    assert sample_patterns(no_components(7), np.zeros((0, 7), int)) == []


def test_doubted_samples_get_all_patterns() -> None:
    together = SignComponents(label=np.zeros(20, int), sign=np.ones(20))
    drawn = np.arange(14).reshape(2, 7)
    one, all_patterns = sample_patterns(together, drawn, np.array([True, False]))
    assert (one.index.tolist(), one.signs.shape) == ([1], (1, 1, 7))
    assert all_patterns.index.tolist() == [0]
    assert (np.unique(all_patterns.signs[0], axis=0) == np.unique(ALL_SIGNS, axis=0)).all()


def test_patterns_left_hold_the_true_F_of_exact_samples() -> None:
    rng = np.random.default_rng(3)
    scene = noisy(3)
    components = sign_components(matches_of(scene.ends))
    drawn = np.stack([rng.choice(2000, 7, replace=False) for _ in range(50)])
    found, tried = np.full(50, np.inf), 0
    for group in sample_patterns(components, drawn):
        F, sample = solve_seven_smears(scene.ends[drawn[group.index]], group.signs)
        either = [np.linalg.norm(F - sign * f, axis=(1, 2)) for sign in (1, -1) for f in (scene.F, scene.F.T)]
        np.minimum.at(found, group.index[sample], np.min(either, axis=0))
        tried += group.signs.shape[0] * group.signs.shape[1]
    assert (found < 1e-4).mean() >= 0.96
    assert tried < 50 * 8


def test_wrong_labels_and_signs_are_refused() -> None:
    with pytest.raises(ValueError, match=r"\(2,\)"):
        SignComponents(label=np.zeros(2, int), sign=np.ones(3))
    with pytest.raises(ValueError, match="signs"):
        SignComponents(label=np.zeros(2, int), sign=np.zeros(2))
