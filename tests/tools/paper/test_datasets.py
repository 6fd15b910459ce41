"""The paper's data sets: tiny trees in their true layouts, whose flow, cameras and F are known."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from blur2view.arrays import Array
from blur2view.geometry.epipolar import fundamental_from_pose, sampson
from tools.datasets.testset import read_test_set
from tools.evaluation import evaluate

WIDTH, HEIGHT, FRAMES = 96, 64, 4
PIXELS: Array = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).astype(float)
R: Array = np.asarray(cv2.Rodrigues(np.array([0.01, -0.02, 0.015]))[0], float)
T, NORMAL = np.array([0.05, 0.02, 0.03]), np.array([0.1, 0.3, 1.0])
STEP: Array = np.vstack([np.c_[R, T], [0, 0, 0, 1]])


def mapped(H: Array, points: Array) -> Array:
    """Map points (..., 2) by a homography."""
    moved = np.concatenate([points, np.ones_like(points[..., :1])], -1) @ H.T
    return np.asarray(moved[..., :2] / moved[..., 2:])


def write(path: Path, picture: Array) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.round(picture).astype(np.uint8)[..., ::-1])


def shifted(pixels: float) -> Array:
    """Codes (H, W, 3) of a fine texture moved right."""
    noise = np.random.default_rng(1).random((HEIGHT * 2, WIDTH * 3, 3)).astype(np.float32)
    large = cv2.GaussianBlur(noise, (0, 0), 2.0)
    large = 255 * (large - large.min()) / np.ptp(large)
    move = np.array([[1, 0, pixels - WIDTH], [0, 1, -HEIGHT / 2]])
    return np.asarray(cv2.warpAffine(large, move, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC).clip(0, 255))


def scene_flow(root: Path, scene: str, focal_px: float, first: int) -> Array:
    """Write frames, flow and cameras of a tilted wall; return the homography of a step."""
    K = np.array([[focal_px, 0, (WIDTH - 1) / 2], [0, focal_px, (HEIGHT - 1) / 2], [0, 0, 1.0]])
    step = np.asarray(K @ (R + np.outer(T, NORMAL)) @ np.linalg.inv(K))
    camera, lines = np.eye(4), []
    for k in range(FRAMES):
        blender = camera @ np.diag([1.0, -1.0, -1.0, 1.0])
        lines += [f"Frame {first + k}", "L " + " ".join(map(repr, blender.ravel().tolist()))]
        lines += ["R " + " ".join(["0"] * 16), ""]
        camera = camera @ np.linalg.inv(STEP)
        name = f"{first + k:04d}"
        write(root / "frames_cleanpass" / scene / "left" / f"{name}.png", shifted(0.0))
        for time, way in (("Future", step), ("Past", np.linalg.inv(step))):
            flow = np.dstack([mapped(np.asarray(way), PIXELS) - PIXELS, np.zeros((HEIGHT, WIDTH))])[::-1]
            path = root / "optical_flow" / scene / f"into_{time.lower()}" / "left"
            path.mkdir(parents=True, exist_ok=True)
            head = f"PF\n{WIDTH} {HEIGHT}\n-1.0\n".encode()
            (path / f"OpticalFlowInto{time}_{name}_L.pfm").write_bytes(head + flow.astype("<f4").tobytes())
    (root / "camera_data" / scene).mkdir(parents=True)
    (root / "camera_data" / scene / "camera_data.txt").write_text("\n".join(lines))
    return step


@pytest.mark.parametrize(
    ("kind", "scene", "focal_px", "steps"),
    [("monkaa", "eating_x2", 105.0, 1), ("driving", "15mm_focallength/scene_forwards/fast", 45.0, 2)],
)
def test_scene_flow_has_exact_smears_and_poses(
    call_tool: Callable[[str], None], tmp_path: Path, kind: str, scene: str, focal_px: float, steps: int
) -> None:
    step = scene_flow(tmp_path / "set", scene, focal_px, first=kind == "driving")
    call_tool(f"paper.datasets {kind} {tmp_path / 'set'} --out {tmp_path / 'out'} --frames {steps}")
    found = read_test_set(tmp_path / "out")
    assert len(found) == (FRAMES - 1) // steps
    relative = np.linalg.matrix_power(STEP, steps)
    for one in found:
        np.testing.assert_allclose(np.c_[one.R, one.t], relative[:3], atol=1e-9)
        assert one.K[0, 0] == focal_px and one.valid[2:-2, 2:-2].all() and not one.valid.all()
        ends, F = one.true_ends, fundamental_from_pose(one.K, one.R, one.t)
        assert one.F is not None and abs(float((one.F * F).sum())) == pytest.approx(1)
        assert np.abs(mapped(np.linalg.matrix_power(step, steps), ends[:, 0]) - ends[:, 1]).max() < 0.1
        assert np.sqrt(sampson(F, ends[:, 0], ends[:, 1])).max() < 0.1


def test_videos_have_chained_flow_and_rbi_its_own_blur_and_all_can_be_evaluated(
    call_tool: Callable[[str], None], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for k in range(1, 7):  # exposures of three frames: 1 to 3 and 4 to 6
        write(tmp_path / "test" / "GOPR0384_03_00" / f"{k:06d}.png", shifted(3.0 * k))
    for k in range(1, 10):
        write(tmp_path / "Sharp" / "_Scene7" / "RGB" / f"{k}.png", shifted(1.0 * k))
    blurred = np.mean([shifted(k) for k in np.linspace(1, 9, 33)], axis=0)
    write(tmp_path / "Blur" / "_Scene7" / "RGB" / "1.png", blurred)
    for kind, count, length in (("gopro", 2, 6.0), ("rbi", 1, 8.0)):
        call_tool(f"paper.datasets {kind} {tmp_path} --out {tmp_path / kind}")
        found = read_test_set(tmp_path / kind)
        assert len(found) == count
        for one in found:
            assert one.valid.mean() > 0.5 and np.isnan(one.t).all()
            smear = np.median(one.displacement[one.valid], axis=0)
            np.testing.assert_allclose(smear, (length, 0), atol=0.2)
    gopro, rbi = (np.asarray(Image.open(tmp_path / kind / "0000.png")) for kind in ("gopro", "rbi"))
    np.testing.assert_array_equal(rbi, np.round(blurred).astype(np.uint8))
    light = np.mean([(shifted(k) / 255) ** 2.2 for k in np.linspace(3, 9, 31)], axis=0)
    assert np.median(np.abs(gopro / 255 - light ** (1 / 2.2))) < 0.02
    evaluate.main(tmp_path / "gopro")
    assert ", 2 images." in capsys.readouterr().out


def test_what_is_missing_is_one_line(call_tool: Callable[[str], None], tmp_path: Path) -> None:
    scene_flow(tmp_path / "set", "eating_x2", 105.0, 0)
    flow = tmp_path / "set/optical_flow/eating_x2/into_past/left/OpticalFlowIntoPast_0001_L.pfm"
    flow.write_bytes(flow.read_bytes()[:-4])
    (tmp_path / "empty" / "test" / "wrong").mkdir(parents=True)
    for words, complaint in (
        (f"monkaa {tmp_path / 'set'}", "0001_L.pfm: is missing or damaged"),
        (f"driving {tmp_path / 'empty'}", "holds no frames_cleanpass"),
        (f"gopro {tmp_path / 'empty'}", "expected a name as GOPR0384_11_00"),
    ):
        with pytest.raises(SystemExit, match=complaint):
            call_tool(f"paper.datasets {words} --out {tmp_path / 'out'}")
