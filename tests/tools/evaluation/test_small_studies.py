"""Small studies: smears against measured ones, rates, poses and times, of known cases."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.smears.field import SmearField
from tests.support.scenes import make_scene
from tools.evaluation import benchmark
from tools.evaluation.benchmark import checkout, in_turn
from tools.evaluation.gyroscope import measured_smears
from tools.evaluation.smear_figures import evaluate_smears
from tools.metrics import pose_error_deg, pose_of


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
    figures = evaluate_smears(measured_smears(field, {"smear": smear}))
    assert figures.direction_deg == pytest.approx(np.degrees(0.05), rel=1e-4)
    assert figures.length_ratio == pytest.approx(1.2, rel=0.01) and figures.length_spread < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_true_F_and_its_transpose_of_any_sign_have_no_error(seed: int) -> None:
    scene = make_scene(np.random.default_rng(seed), count=200)
    for F in (scene.F, -scene.F, 3 * scene.F.T):
        assert pose_error_deg(F, scene.K, scene.R, scene.t, scene.ends) < 1e-4
    pose = pose_of(scene.F, scene.K, np.stack(scene.ordered, axis=1))
    np.testing.assert_allclose(pose.rotation, scene.R, atol=1e-6)
    np.testing.assert_allclose(pose.translation, scene.t / np.linalg.norm(scene.t), atol=1e-6)


@pytest.mark.slow
def test_every_stage_runs_and_leaves_its_files(tmp_path: Path) -> None:
    photo, out = tmp_path / "photo.png", tmp_path / "out"
    texture = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    assert cv2.imwrite(str(photo), cv2.GaussianBlur(texture, (0, 0), 2.0))
    out.mkdir()
    times = benchmark.stages(photo, out, repeats=1)
    assert {"decode", "network", "matches", "solve", "draw and write", "decode to F"} < set(times)
    assert {path.name for path in out.glob("*.json")} == {"photo.json"} and (out / "stages.png").exists()


def test_processes_of_two_trees_take_turns_and_a_failure_ends_the_benchmark(tmp_path: Path) -> None:
    said = tmp_path / "said"
    code = f"import os; open({str(said)!r}, 'a').write(os.environ['PYTHONPATH'][-1])"
    trees = [tmp_path / name for name in "ab"]
    for tree in trees:
        tree.mkdir()
    runs = in_turn(trees, ["-c", code], repeats=2)
    assert said.read_text() == "abab" and len(runs) == 2 and runs[0][2] > 1
    with pytest.raises(SystemExit, match="ends with 3"):
        in_turn(trees, ["-c", "raise SystemExit(3)"], repeats=1)
    with pytest.raises(SystemExit, match="no-commit: is no commit"):
        checkout("no-commit", tmp_path / "c")
