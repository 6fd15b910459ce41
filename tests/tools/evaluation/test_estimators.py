"""The estimators' comparison: every method is judged, and what the tables say."""

from pathlib import Path

import pytest

from tools.datasets.synthetic_matches import SyntheticOptions, synthetic_smears
from tools.evaluation import estimators
from tools.evaluation.baselines import METHODS, ORDERED, OURS, PAPER

CELL = "noise 0.25 px"
PERFECT = {"rho": 0.0, "under_05": 1.0, "under_10": 1.0, "inliers": 1.0, "epipole_deg": 0.0, "pose_deg": 0.0}
EASY = synthetic_smears(0, SyntheticOptions(kind="scattered", noise_px=0.25))
WORST = estimators.judge(None, EASY)


@pytest.mark.slow
def test_every_method_is_judged_and_the_page_is_filled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimators, "CELLS", {CELL: estimators.CELLS[CELL]})
    found = estimators.run_instance((CELL, "scattered", 0), paper_seeds=range(0))
    assert set(found) == set(METHODS) - {PAPER}
    for name, measured in found.items():
        assert measured["ms"] > 0 and 0 <= measured["rho"] <= 1 and 0 <= measured["pose_deg"] <= 180
        if name == OURS or name in ORDERED:
            assert measured["rho"] < 0.01 and measured["pose_deg"] < 10
    records = {(CELL, kind, 0): found for kind in estimators.KINDS}
    monkeypatch.setattr(estimators, "mapped", lambda *_: records.values())
    estimators.main(seeds=1, out=tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text()
    assert "## Cell by cell, smooth depth" in text and f"| {CELL} | " in text and "nan" not in text


def test_the_true_F_is_perfect_and_none_the_worst() -> None:
    true = estimators.judge(EASY.F, EASY)
    assert true == pytest.approx(PERFECT, abs=1e-3)
    assert WORST["rho"] == 1 and WORST["inliers"] == 0 and WORST["pose_deg"] == 180


def test_figures_are_medians_of_errors_and_means_of_shares() -> None:
    times = (10.0, 30.0, 10.0, 10.0)
    rows = [one | {"ms": ms} for one, ms in zip((PERFECT, PERFECT, WORST, WORST), times, strict=True)]
    f = estimators.figures(rows)
    assert f["n"] == 4 and f["rho"] == 0.5 and f["ms"] == 10
    assert all(f[name] == 0.5 for name in ("success", "AUC@10", "inliers"))
