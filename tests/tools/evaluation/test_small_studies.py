"""Small studies: poses and times of known cases, and a page of kinds of blur whose pictures are known."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.scenes import make_scene
from tools.evaluation import benchmark, blur_kinds
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
    photo, names = tmp_path / "photo.png", {"FRAMES": 2, "WARM": 1, "STREAMS": ((160, 120),)}
    texture = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    assert cv2.imwrite(str(photo), cv2.GaussianBlur(texture, (0, 0), 2.0))
    for name, value in names.items():
        monkeypatch.setattr(benchmark, name, value)
    steps = benchmark.step_rows(photo, [photo, photo], repeats=1)
    assert steps[-1][2] == "1.00" and all(float(seconds) >= 0 for _, seconds, _ in steps)
    assert len(list(benchmark.stream_rows(texture.astype(np.float32) / 255))) == 1
    with pytest.raises(SystemExit, match="ends with 1"):
        benchmark.measured(["estimate", tmp_path / "missing.jpg"], repeats=1)


@pytest.mark.slow
def test_most_kinds_of_blur_of_a_photograph_of_grain_are_named(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for k in range(2):
        grain = cv2.GaussianBlur(rng.uniform(0, 1, (256, 320)), (0, 0), 0.8)[..., None]
        pixels = 255 * np.clip(0.5 + (grain - 0.5) * 1.5 + 0.1 * np.eye(3)[k], 0, 1)
        assert cv2.imwrite(str(tmp_path / f"{k}.png"), pixels.round().astype(np.uint8))
    rows = blur_kinds.of_photograph(0, sorted(tmp_path.iterdir()), None, 0, 1)
    clear = [one for one in rows if one.is_unusable and one.picture.kind != "camera at rest"]
    assert np.mean([one.kind == one.picture.kind for one in clear]) > 0.8
    text = "\n".join(map(str, blur_kinds.page(rows)))
    assert "nan" not in text and "| camera moved 12 px, 1/8 | 1 |" in text and "| 40 px | 1 |" in text
