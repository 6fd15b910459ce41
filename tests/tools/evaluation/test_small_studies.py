"""Sharp photographs, rates and the coverage of poses: figures of cases whose answer is known."""

from pathlib import Path

import numpy as np

from blur2view.geometry.rotation import rotation_matrix
from blur2view.results.table import Row, table_text
from blur2view.smears.grid import SmearGrid
from tools.evaluation import pose_coverage, rates, sharp


def test_only_long_and_known_smears_are_sure_and_the_worst_photograph_comes_first() -> None:
    cells = np.zeros((1, 4, 4), np.float32)
    cells[0, :, 0] = -8, 8, 1, 0
    cells[0, :, 2] = 1, 6, 0.1, 0.1
    assert sharp.sure_share(SmearGrid(cells=cells, stride=32, shape=(32, 128))) == 0.25
    rows = [
        sharp.Reading(name="wall", verdict="DEGENERATE: no motion", length_px=0.3, sure_share=0.0),
        sharp.Reading(name="sky", verdict="PLANAR: it moves", length_px=6.0, sure_share=0.5),
    ]
    lines = sharp.page(rows).splitlines()
    assert lines[0].startswith("1 of 2 without motion; 25.00%") and lines[4].startswith("| sky")


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
