"""The comparison of estimators: every method is judged, and what the tables say."""

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
def test_every_method_is_judged_and_the_page_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimators, "CELLS", {CELL: estimators.CELLS[CELL]})
    found = estimators.run_instance((CELL, "scattered", 0), paper_seeds=range(0))
    assert set(found) == set(METHODS) - {PAPER}
    for name in (OURS, *ORDERED):
        assert found[name]["rho"] < 0.01 and found[name]["pose_deg"] < 10 and found[name]["ms"] > 0
    monkeypatch.setattr(estimators, "mapped", lambda *_: [found, found])
    estimators.main(seeds=1, out=tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text()
    assert "## Cell by cell, smooth depth" in text and f"| {CELL} | " in text and "nan" not in text


def test_the_true_F_is_perfect_and_figures_are_medians_of_errors_and_means_of_shares() -> None:
    assert estimators.judge(EASY.F, EASY) == pytest.approx(PERFECT, abs=1e-3)
    rows = [{**one, "ms": ms} for one, ms in ((PERFECT, 10.0), (PERFECT, 30.0), (WORST, 10.0), (WORST, 10.0))]
    figures = estimators.by_method([{"method": one} for one in rows])["method"]
    assert figures["n"] == 4 and figures["rho"] == 0.5 and figures["ms"] == 10
    assert all(figures[name] == 0.5 for name in ("success", "AUC@10", "inliers"))
