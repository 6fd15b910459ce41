"""The evaluation of photographs: what perfect and stretched smears score, and that every method is judged."""

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
from tools.rendering.render import RenderOptions, render

SIZE = (160, 128)
OPTIONS = RenderOptions(size=SIZE, smear_px=(8.0, 12.0), mover_share=0.0)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> TestScene:
    """Render a scene whose camera translates and turns."""
    truth = render(6, OPTIONS)
    assert truth.F is not None and not np.array_equal(truth.R, np.eye(3))
    fields = {name: getattr(truth, name) for name in (*testset.ARRAYS, "F", "kind")}
    path = tmp_path_factory.mktemp("scene") / "0000.png"
    cv2.imwrite(str(path), (255 * np.clip(truth.linear[..., ::-1], 0, 1)).astype(np.uint8))
    return TestScene(name="0000", image_path=path, **fields)


def true_grid(scene: TestScene, factor: float = 1.0) -> SmearGrid:
    """Give the true smears, stretched, with a sigma that grows to the right."""
    sigma_px = np.linspace(0.5, 1.5, scene.displacement.shape[1])
    return grid_of(factor * scene.displacement, sigma_px, stride=4)


def test_perfect_smears_have_no_error_and_stretched_ones_their_stretch(scene: TestScene) -> None:
    smears = [evaluate.pooled([(scene, true_grid(scene, factor))]) for factor in (1.0, 1.5)]
    perfect, longer = map(evaluate.smear_figures, smears)
    assert perfect["epe_s"] < 0.1 and perfect["direction_deg"] < 0.2
    assert longer["epe_s_over_length"] == pytest.approx(0.5, rel=0.02)
    assert longer["epe_s_top50_over_length"] == pytest.approx(0.5, rel=0.02)
    assert longer["length_ratio"] == pytest.approx(1.5, rel=0.02) and longer["direction_deg"] < 0.2
    length = np.linalg.norm(scene.displacement[scene.valid], axis=1)
    octaves = list(evaluate.by_octave(smears[1]))
    assert sum(int(row[1]) for row in octaves) == ((length >= 1) & (length < 128)).sum()
    assert all(float(row[5]) == pytest.approx(0.5, rel=0.02) for row in octaves)


def test_every_method_is_judged_and_a_true_F_is_of_the_true_ends_in_order(scene: TestScene) -> None:
    ends = scene.true_ends
    assert len(ends) == (scene.valid & scene.static).sum() and scene.F is not None
    assert np.median(sampson(scene.F, ends[:, 0], ends[:, 1])) < 0.05**2
    (rows,) = evaluate.of_methods([(replace(scene), true_grid(scene))])
    assert rows["true F"]["inliers"] == 1 and rows["true F"]["rho"] < 0.01
    assert rows["ours"]["rho"] < rows["two-parameter F"]["rho"]
    for name in ("OpenCV MAGSAC", "pycolmap", "PoseLib"):
        assert rows[f"true order, {name}"]["rho"] < 0.05
