"""Small studies: poses and times of known cases."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.scenes import make_scene
from tools.evaluation import benchmark
from tools.metrics import pose_error_deg, pose_of


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
