"""Small studies: smears against measured ones, rates, poses and times, of known cases."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from blur2view.smears.field import SmearField
from tests.support.scenes import make_scene
from tools.evaluation import benchmark
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
def test_steps_and_streams_are_timed_and_a_process_that_fails_ends_the_benchmark(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    photo, names = tmp_path / "photo.png", {"FRAMES": 2, "WARM": 1, "STREAMS": ((160, 120),), "THREADS": (1,)}
    texture = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    assert cv2.imwrite(str(photo), cv2.GaussianBlur(texture, (0, 0), 2.0))
    for name, value in names.items():
        monkeypatch.setattr(benchmark, name, value)
    steps = benchmark.step_rows(photo, [photo, photo], repeats=1)
    assert steps[-1][2] == "1.00" and all(float(seconds) >= 0 for _, seconds, _ in steps)
    assert len(list(benchmark.stream_rows(texture.astype(np.float32) / 255))) == 2
    with pytest.raises(SystemExit, match="ends with 1"):
        benchmark.measured(["estimate", tmp_path / "missing.jpg"], repeats=1)
