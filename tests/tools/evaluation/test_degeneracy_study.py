"""The study of degeneracy: scenes are what they say, the same for the same seed; the table counts rightly."""

from dataclasses import replace

import numpy as np
import pytest

from blur2view.geometry.epipolar import fundamental_from_pose
from blur2view.geometry.sampson import serrmin
from blur2view.geometry.two_view_geometry import Configuration, MotionModel, TwoViewGeometry
from blur2view.robust.homography import transfer_orders
from blur2view.robust.homography_search import find_plane
from blur2view.robust.residuals import WeightedEnds
from tools.datasets.degenerate_scenes import KINDS, Kind, draw_scene, with_shared_errors
from tools.evaluation.degeneracy import RIGHT, Named, confusions, erring, name_scene, outcome


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_smears(kind: Kind) -> None:
    one, two, other = draw_scene(kind, 3), draw_scene(kind, 3), draw_scene(kind, 5)
    assert one.matches.ends.tobytes() == two.matches.ends.tobytes()
    assert one.matches.ends.shape != other.matches.ends.shape or not np.allclose(
        one.matches.ends, other.matches.ends
    )
    assert 1000 <= len(one.matches) < 2000


@pytest.mark.parametrize("kind", ["plane", "pure translation", "general"])
def test_true_smears_follow_the_true_F(kind: Kind) -> None:
    for seed in range(3):
        scene = draw_scene(kind, seed)
        F = fundamental_from_pose(scene.K, scene.R, scene.t)
        assert serrmin(F, scene.true_ends).max() < 1e-12


@pytest.mark.parametrize("kind", ["pure rotation", "plane", "general"])
def test_only_rotations_and_planes_are_one_homography(kind: Kind) -> None:
    scene = draw_scene(kind, 1)
    matches = WeightedEnds(ends=scene.true_ends / 768, sigma=np.full(len(scene.true_ends), 0.1 / 768))
    plane = find_plane(matches, True, np.random.default_rng(0))
    assert plane is not None
    inside = np.mean(np.abs(transfer_orders(plane.generator(), matches).least) < 3)
    assert inside > 0.99 if kind != "general" else inside < 0.9


def test_several_and_random_take_turns() -> None:
    two, field = draw_scene("several or none", 2), draw_scene("several or none", 3)
    F = fundamental_from_pose(two.K, two.R, two.t)
    first = (serrmin(F, two.true_ends) < 1e-12).mean()
    assert 0.5 <= first <= 0.6  # 40 to 50 % follow the second motion
    length = np.linalg.norm(field.true_ends[:, 1] - field.true_ends[:, 0], axis=1)
    assert np.ptp(length) < 1e-9


def test_shared_errors_turn_and_stretch_about_the_midpoint_and_are_stated() -> None:
    scene = draw_scene("general", 2)
    moved = erring(scene, 0, 4.0).matches
    assert np.allclose(moved.midpoint, scene.matches.midpoint)
    assert 0.1 < np.log(moved.length_px / scene.matches.length_px).std() < 0.2
    assert (moved.sigma_px > scene.matches.sigma_px).all()
    (x, y), (u, v) = scene.matches.displacement.T, moved.displacement.T
    turned = np.abs(np.arctan((x * v - y * u) / (x * u + y * v))) * moved.length_px
    assert 0.5 < np.sqrt(np.mean((turned / moved.across_px) ** 2)) < 1.2
    assert 10 < len(moved) * moved.shared.all_correlation < 60
    middle = np.random.default_rng(0).uniform(100, 104, (50, 2))  # neighbours err by the same
    ends = np.stack([middle - [10.0, 0], middle + [10.0, 0]], axis=1)
    disturbed = with_shared_errors(ends, np.random.default_rng(1), 4.0, 0.1)
    angle = np.arctan2(*(disturbed[:, 1] - disturbed[:, 0]).T[::-1])
    assert np.ptp(angle) < np.radians(1) < np.abs(angle).max() + np.radians(1)


def test_outcomes_name_configurations() -> None:
    scene = draw_scene("pure rotation", 0)
    none = np.zeros(len(scene.matches), bool)
    geometry = TwoViewGeometry(
        F=None, config=Configuration.PANORAMIC, reason="", inlier_mask=none, swapped=none
    )
    assert outcome(geometry, scene) == "rotation"
    either = replace(geometry, config=Configuration.PLANAR_OR_PANORAMIC)
    assert outcome(either, scene) == "rotation or plane"
    assert outcome(replace(either, F=np.eye(3)), scene) == "open"
    costs = ((MotionModel.CAMERA, 0.0), (MotionModel.TRANSLATION, 1.0))
    uncalibrated = replace(either, F=np.eye(3), config=Configuration.UNCALIBRATED)
    assert outcome(replace(uncalibrated, model=MotionModel.CAMERA, scores=costs), scene) == "translation"


def test_table_counts_what_is_right() -> None:
    rows = [
        Named(kind=kind, outcome=RIGHT[kind][0], rho=0.0, seconds=0.0) for kind in KINDS for _ in range(3)
    ]
    rows += [Named(kind="plane", outcome="general", rho=0.0, seconds=0.0)]
    lines = confusions(rows)
    assert len(lines) == 2 + len(KINDS) + 1
    assert "| 75.0 |" in next(line for line in lines if line.startswith("| plane"))
    assert lines[-1].endswith(f"| {100 * 18 / 19:.1f} |")


@pytest.mark.slow
def test_one_scene_of_each_kind_is_named() -> None:
    named = [name_scene((kind, 1)) for kind in KINDS]
    assert sum(row.outcome in RIGHT[kind] for row, kind in zip(named, KINDS, strict=True)) >= 5
    assert all(row.seconds > 0 for row in named)
