"""Series of rates against poses: signs and correlations."""

from pathlib import Path

import numpy as np

from blur2view.geometry.rotation import rotation_matrix
from blur2view.results.table import Row, table_text
from tools.evaluation.rates import averaged, rates_of_poses, rates_of_table, rates_of_tracks, table

RNG = np.random.default_rng(0)
STEPS = 0.01 * RNG.normal(size=(40, 3)).cumsum(axis=0)


def test_true_rates_agree_and_reversed_ones_point_the_other_way(tmp_path: Path) -> None:
    poses = [np.eye(3)]
    for step in STEPS:
        poses.append(rotation_matrix(step) @ poses[-1])
    frames = np.arange(100, 141)
    cam_from_world = np.concatenate([np.array(poses), np.zeros((41, 3, 1))], axis=2)
    np.savez(tmp_path / "poses.npz", frame=frames, cam_from_world=cam_from_world)
    true = rates_of_poses(tmp_path / "poses.npz")
    rows = []
    for frame, (x, y, z) in true.items():
        if frame != 120:
            rows.append(Row(name=f"a/{frame:06d}.jpg", wx=-25 * x, wy=-25 * y, wz=-25 * z))
        np.savez(tmp_path / f"{frame:06d}.npz", R=rotation_matrix(np.array([x, y, z])))
    (tmp_path / "rates.csv").write_text(table_text([*rows, Row(name="a/000120.jpg")]))
    rates, tracks = rates_of_table(tmp_path / "rates.csv"), rates_of_tracks(tmp_path)
    assert len(rates) == 40 and 120 not in rates and len(averaged(rates)) == 40 - 4 - 4
    found = table(rates, true, tracks).splitlines()
    assert found[2] == "| photographs, poses | 40 | 0.0% | -1.000 | -1.000 | -1.000 |"
    assert found[5] == "| poses, tracks | 41 | 100.0% | 1.000 | 1.000 | 1.000 |"
    assert len(table(rates, true, {}).splitlines()) == 4
