"""The correlated-noise study: what the noise is, that ordered ends stay in order, the oracles are near."""

from pathlib import Path

import numpy as np
import pytest

from blur2view.metrics import rho
from tests.tools.evaluation.test_evaluate import OPTIONS, SIZE
from tools.datasets import testset
from tools.datasets.testset import TestScene
from tools.evaluation import correlated_noise as study
from tools.evaluation.evaluate import true_ends
from tools.rendering.render import render


@pytest.fixture(scope="module")
def scene() -> TestScene:
    """Render a scene whose camera translates and turns."""
    truth = render(4, OPTIONS)
    fields = {name: getattr(truth, name) for name in ("displacement", "valid", "static", "K", "R", "t", "F")}
    return TestScene(name="0004", image_path=Path("0004.png"), kind=truth.kind, **fields)


def level(direction_deg: float, length_share: float) -> study.Level:
    return study.Level(direction_deg=direction_deg, length_share=length_share)


def test_noise_turns_and_stretches_about_the_midpoint_as_much_as_asked(scene: TestScene) -> None:
    quiet, noisy = (
        study.disturb(scene, at, np.random.default_rng(0)) for at in (level(0, 0), level(4, 0.15))
    )
    before, after = (data.ends[:, 1] - data.ends[:, 0] for data in (quiet, noisy))
    np.testing.assert_allclose(quiet.ends.mean(axis=1), noisy.ends.mean(axis=1), atol=1e-9)
    cross, dot = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1)
    assert np.degrees(np.arctan2(cross, dot)).std() == pytest.approx(4, rel=0.5)
    assert np.log(noisy.length_px / quiet.length_px).std() == pytest.approx(0.15, rel=0.5)


def test_noise_is_alike_nearby_and_of_unit_variance() -> None:
    points = np.stack(np.meshgrid(np.arange(2, 640, 4.0), np.arange(2, 480, 4.0)), -1).reshape(-1, 2)
    field = study.smooth_noise(np.random.default_rng(1), points, (640, 480)).reshape(120, 160)
    assert field.std() == pytest.approx(1)
    assert np.std(field[:, 1:] - field[:, :-1]) < 0.1
    assert np.std(field[:, 40:] - field[:, :-40]) > 0.8


def test_told_ends_know_one_order_only(scene: TestScene) -> None:
    assert scene.F is not None
    ends = true_ends(scene)
    told = study.OrderedEnds(ends=ends, sigma=np.full(len(ends), 0.5))
    assert np.median(told.residuals(scene.F).squared) < 0.01
    assert np.median(told.residuals(scene.F.T).squared) > 100


@pytest.mark.parametrize("family", ["general F", "E"])
def test_oracle_on_exact_smears_is_the_truth(scene: TestScene, family: str) -> None:
    F, R, t = study.oracle(family, study.disturb(scene, level(0.1, 0.0), np.random.default_rng(2)))
    assert np.median(rho(F, true_ends(scene))) < 0.01
    assert (R is None) == (family == "general F") == (t is None)


@pytest.mark.slow
def test_tables_show_every_method_at_both_levels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for index in (3, 4):
        testset.write_scene(index, tmp_path, testset.test_options(None, SIZE))
    monkeypatch.setattr(study, "DRAWS", 1)
    outcomes = study.study(next(s for s in testset.read_test_set(tmp_path) if s.F is not None))
    assert len(outcomes) == 8 * len(study.METHODS)
    text = study.markdown(outcomes, 1)
    assert all(text.count(f"| {name} |") == 2 for name in study.METHODS)
    assert (
        text.count("| ours over oracle, general F |")
        == text.count("| oracle, E: rotation, translation |")
        == 2
    )
    monkeypatch.setattr("sys.argv", ["correlated_noise", str(tmp_path / "nothing")])
    with pytest.raises(SystemExit, match="no scenes"):
        study.main()
