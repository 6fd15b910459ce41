"""The evaluation: what perfect and absent answers score, and that the command writes both tables."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from blur2view import SmearGrid
from blur2view.geometry.epipolar import sampson
from tests.support.grids import grid_of
from tools.datasets import testset
from tools.datasets.testset import TestScene
from tools.evaluation import evaluate
from tools.evaluation.evaluate import by_octave, pooled, smear_figures
from tools.rendering.render import RenderOptions, render

SIZE = (160, 128)
OPTIONS = RenderOptions(
    size=SIZE, split="test", smear_px=(8.0, 12.0), sharp_share=0.0, mover_share=0.0, straight=True
)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> TestScene:
    """Render a scene whose camera translates and turns."""
    truth = render(4, OPTIONS)
    assert truth.F is not None and not np.array_equal(truth.R, np.eye(3))
    fields = {name: getattr(truth, name) for name in (*testset.ARRAYS, "F", "kind")}
    path = tmp_path_factory.mktemp("scene") / "0000.png"
    cv2.imwrite(str(path), (255 * np.clip(truth.linear[..., ::-1], 0, 1)).astype(np.uint8))
    return TestScene(name="0000", image_path=path, **fields)


def true_grid(scene: TestScene, factor: float = 1.0) -> SmearGrid:
    """Give the true smears, stretched, with a sigma that grows to the right."""
    sigma_px = np.linspace(0.5, 1.5, scene.displacement.shape[1])
    return grid_of(factor * scene.displacement, sigma_px, stride=4)


def test_perfect_field_has_no_error_and_a_stretched_one_its_stretch(scene: TestScene) -> None:
    smears = [pooled([(scene, true_grid(scene, factor))]) for factor in (1.0, 1.5)]
    perfect, longer = map(smear_figures, smears)
    assert perfect["epe_s"] < 0.1 and perfect["direction_deg"] < 0.2
    assert longer["epe_s_over_length"] == pytest.approx(0.5, rel=0.02)
    assert longer["epe_s_top50_over_length"] == pytest.approx(0.5, rel=0.02)
    assert longer["length_ratio"] == pytest.approx(1.5, rel=0.02) and longer["direction_deg"] < 0.2
    length = np.linalg.norm(scene.displacement[scene.valid], axis=1)
    octaves = list(by_octave(smears[1]))
    assert sum(o["smears"] for o in octaves) == ((length >= 1) & (length < 128)).sum()
    for octave in octaves:
        inside = (length >= octave["from_px"]) & (length < 2 * octave["from_px"])
        assert octave["smears"] == inside.sum() > 0
        assert octave["length_ratio"] == pytest.approx(1.5, abs=0.1 / octave["from_px"])
        assert octave["epe_s_over_length"] == pytest.approx(0.5, rel=0.02) and octave["direction_deg"] < 0.2


def test_no_F_is_the_worst_answer_and_the_true_F_the_best(scene: TestScene) -> None:
    ends = scene.true_ends
    assert len(ends) == (scene.valid & scene.static).sum() and scene.F is not None
    assert np.median(sampson(scene.F, ends[:, 0], ends[:, 1])) < 0.05**2  # in this order
    none, true = (evaluate.judge(F, scene.F, scene.K, ends) for F in (None, scene.F))
    assert [none[name] for name in ("rho", "under_05", "under_10", "inliers")] == [1, 0, 0, 0]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert none["serrmin_px2"] == pytest.approx(np.median(length**2)) and none["epipole_deg"] == 90
    assert true["serrmin_px2"] < 0.05**2 and true["epipole_deg"] < 1e-3
    assert true["rho"] < 0.01 and true["under_05"] == true["under_10"] == true["inliers"] == 1
    row = evaluate.summarise("half", [none, true], 1.0, missing=1)
    assert [row[name] for name in ("images", "without_F", "inliers", "inliers_of_true")] == [2, 1, 0.5, 0.5]


def test_every_method_is_judged_on_scenes_with_translation_alone(scene: TestScene) -> None:
    pairs = [(scene, true_grid(scene)), (replace(scene, F=None), true_grid(scene))]
    rows = {row["method"]: row for row in evaluate.evaluate_fundamentals(pairs)}
    assert len(rows) == 8 and {row["images"] for row in rows.values()} == {1}
    assert rows["true F"]["inliers_of_true"] == 1 and rows["true F"]["rho"] < 0.01
    assert rows["ours"]["without_F"] == 0 and rows["ours"]["rho"] < rows["two-parameter F"]["rho"]
    for name in ("OpenCV MAGSAC", "pycolmap", "PoseLib"):
        assert rows[f"true order, {name}"]["rho"] < 0.05
