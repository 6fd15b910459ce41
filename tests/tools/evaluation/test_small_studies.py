"""Small studies: smears against measured ones, rates, poses and times, of known cases."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.geometry.epipolar import fundamental_from_pose
from blur2view.geometry.rotation import rotation_matrix
from blur2view.results.table import Row, table_text
from blur2view.smears.field import SmearField
from tests.support.scenes import make_scene, rotation
from tools.evaluation import benchmark, pose_coverage, rates
from tools.evaluation.gyroscope import figures_of, page, pairs_of
from tools.evaluation.smear_figures import lean_deg
from tools.metrics import pose_auc, pose_error_deg, pose_of


def field_of(displacement: tuple[float, float], sigma_rad: np.ndarray) -> SmearField:
    """Return one smear everywhere."""
    shape = sigma_rad.shape
    return SmearField(
        displacement=np.full((*shape, 2), displacement, np.float32),
        sigma_px=np.ones(shape, np.float32),
        sigma_rad=sigma_rad,
    )


@pytest.mark.parametrize("sign", [1, -1])
def test_a_turn_and_a_factor_are_measured(sign: int) -> None:
    turned = 1.2 * 20 * np.array([np.cos(0.05), np.sin(0.05)])
    smear = np.full((8, 12, 2), (20 * sign, 0), np.float16)
    field = field_of(tuple(turned), np.full((32, 48), 0.1, np.float32))
    figures = figures_of(*pairs_of(field, {"smear": smear}))
    assert figures.length_px == 20
    assert figures.direction_deg == pytest.approx(np.degrees(0.05), rel=1e-5)
    assert figures.signed_deg_top50 == pytest.approx(np.degrees(0.05), rel=1e-5)
    assert (figures.length_ratio, figures.length_spread) == pytest.approx((1.2, 0), abs=1e-6)


def test_the_surer_half_is_judged_apart() -> None:
    field = field_of((20, 0), np.repeat(np.array([[0.1] * 24 + [0.5] * 24], np.float32), 32, 0))
    smear = np.zeros((8, 12, 2), np.float32)
    smear[:, :6], smear[:, 6:] = (20, 0), (0, 20)
    figures = figures_of(*pairs_of(field, {"smear": smear}))
    assert figures.direction_deg_top50 == pytest.approx(0, abs=1e-5)
    assert figures.direction_deg == pytest.approx(45)
    assert "| median | 20.0 |" in page({"one": figures, "other": figures})[-1]


def test_flow_counts_where_it_is_valid_and_long() -> None:
    flow, valid = np.full((8, 12, 2), (6, 0), np.float16), np.ones((8, 12), bool)
    flow[0], valid[:, 0] = (1, 0), False
    field = field_of((6, 0), np.full((32, 48), 0.1, np.float32))
    read, true, _ = pairs_of(field, {"flow": flow, "valid": valid})
    assert len(read) == len(true) == 7 * 11


@pytest.mark.parametrize("axis", [0, 90, 180, 270])
@pytest.mark.parametrize("apart", [20, -20])
def test_a_lean_towards_the_axes_is_positive_on_both_sides(axis: int, apart: int) -> None:
    def smear(degrees: float) -> np.ndarray:
        return np.array([[np.cos(np.radians(degrees)), np.sin(np.radians(degrees))]])

    assert lean_deg(smear(axis + 0.9 * apart), smear(axis + apart)) == pytest.approx(2)
    assert lean_deg(-smear(axis + 1.2 * apart), smear(axis + apart)) == pytest.approx(-4)


def test_reversed_rates_point_the_other_way(tmp_path: Path) -> None:
    poses = [np.eye(3)]
    for step in 0.01 * np.random.default_rng(0).normal(size=(40, 3)).cumsum(axis=0):
        poses.append(rotation_matrix(step) @ poses[-1])
    cam_from_world = np.concatenate([np.array(poses), np.zeros((41, 3, 1))], axis=2)
    np.savez(tmp_path / "poses.npz", frame=np.arange(100, 141), cam_from_world=cam_from_world)
    true = rates.rates_of_poses(tmp_path / "poses.npz")
    rows = [Row(name=f"a/{k:06d}.jpg", wx=-25 * x, wy=-25 * y, wz=-25 * z) for k, (x, y, z) in true.items()]
    rows[20] = Row(name="a/000120.jpg")
    (tmp_path / "rates.csv").write_text(table_text(rows))
    found = rates.rates_of_table(tmp_path / "rates.csv")
    assert len(found) == 40 and 120 not in found and len(rates.averaged(found)) == 40 - 4 - 4
    assert "| 40 | 0.0% | -1.000 | -1.000 | -1.000 |" in rates.page(true, found).splitlines()[2]
    assert "| 41 | 100.0% | 1.000 | 1.000 | 1.000 |" in rates.page(true, true)


def test_a_study_of_coverage_repeats_keeps_its_truth_and_has_a_row_for_each_case() -> None:
    for case in pose_coverage.CASES[::3]:
        (scene, one), (_, two) = (pose_coverage.observed(3, case) for _ in range(2))
        np.testing.assert_array_equal(one.ends, two.ends)
        assert len(one) == len(scene.true_ends)
    case = pose_coverage.CASES[0]
    found = pose_coverage.outcome(case, 0)
    assert found is not None and found[3] < 0.5
    assert f"| {case.name} | 1 |" in pose_coverage.markdown({case: [found, None]})


@pytest.mark.parametrize("seed", range(5))
def test_true_F_and_its_transpose_of_any_sign_have_no_error(seed: int) -> None:
    scene = make_scene(np.random.default_rng(seed), count=200)
    for F in (scene.F, -scene.F, 3 * scene.F.T):
        assert pose_error_deg(F, scene.K, scene.R, scene.t, scene.ends) < 1e-4
    pose = pose_of(scene.F, scene.K, np.stack(scene.ordered, axis=1))
    np.testing.assert_allclose(pose.rotation, scene.R, atol=1e-6)
    np.testing.assert_allclose(pose.translation, scene.t / np.linalg.norm(scene.t), atol=1e-6)


def test_error_is_the_larger_of_rotation_and_translation() -> None:
    scene = make_scene(np.random.default_rng(6), count=200)
    axis = np.cross(scene.t, [1.0, 0, 0])
    tilt = rotation(np.radians(7) * axis / np.linalg.norm(axis))
    other = fundamental_from_pose(scene.K, scene.R, tilt @ scene.t)
    assert pose_error_deg(other, scene.K, scene.R, scene.t, scene.ends) == pytest.approx(7, abs=0.01)
    turned = fundamental_from_pose(scene.K, rotation(np.radians([0, 0, 3.0])) @ scene.R, scene.t)
    assert pose_error_deg(turned, scene.K, scene.R, scene.t, scene.ends) == pytest.approx(3, abs=0.01)


def test_auc_is_one_without_errors_zero_beyond_the_bound_and_half_between() -> None:
    assert pose_auc(np.zeros(3), 10) == 1 and pose_auc(np.full(3, 11.0), 10) == 0
    assert pose_auc(np.full(3, 5.0), 10) == pytest.approx(0.5)
    assert pose_auc(np.zeros(0), 10) == 0


@pytest.mark.slow
def test_every_stage_runs_and_leaves_its_files(tmp_path: Path) -> None:
    photo, out = tmp_path / "photo.png", tmp_path / "out"
    texture = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    assert cv2.imwrite(str(photo), cv2.GaussianBlur(texture, (0, 0), 2.0))
    out.mkdir()
    times = benchmark.stages(photo, out, repeats=1)
    assert {"decode", "network", "matches", "solve", "draw and write", "decode to F"} < set(times)
    assert {path.name for path in out.glob("*.json")} == {"photo.json", "stages.json"}


def test_the_first_call_is_extra_and_the_table_gives_ratios_memory_and_machine() -> None:
    calls: list[int] = []
    assert benchmark.timed(lambda: calls.append(1), 3) >= 0 and len(calls) == 4
    text = benchmark.page({"decode": 0.5}, (1.0, 345.6), 0.25, repeats=9)
    assert "| decode | 0.500 | 2.00 |" in text and "346 MiB" in text
    assert "cores; medians of 9 runs; one 1280x720 photograph" in text
