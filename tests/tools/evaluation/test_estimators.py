"""The estimators' comparison: every method is judged, and what the tables say."""

from pathlib import Path

import pytest

from tools.estimators.baselines import METHODS, ORDERED, OURS, PAPER
from tools.evaluation import estimators

CELL = "noise 0.25 px"
EASY = {"seed": 0, "cell": CELL, "kind": "scattered"}
PERFECT = {"rho": 0.0, "under_05": 1.0, "under_10": 1.0, "inliers": 1.0, "epipole_deg": 0.0, "pose_deg": 0.0}
PERFECT |= {"ms": 10.0}
ABSENT = PERFECT | {"rho": 1.0, "under_05": 0.0, "under_10": 0.0, "inliers": 0.0, "pose_deg": 180.0}


@pytest.mark.slow
def test_every_method_is_judged_and_the_page_is_filled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimators, "CELLS", {name: estimators.CELLS[name] for name in [CELL]})
    found = estimators.run_instance(EASY, paper_seeds=range(0))
    assert set(found["measured"]) == set(METHODS) - {PAPER}
    for name, measured in found["measured"].items():
        assert measured["ms"] > 0 and 0 <= measured["rho"] <= 1 and 0 <= measured["pose_deg"] <= 180
        if name == OURS or name in ORDERED:
            assert measured["rho"] < 0.01 and measured["pose_deg"] < 10
    worst = estimators.measure(lambda _: None, estimators.synthetic_problem(EASY))
    assert worst["rho"] == 1 and worst["pose_deg"] == 180
    estimators.main(seeds=1, paper_seeds=0, jobs=1, out=tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text()
    assert "## Cell by cell, smooth depth" in text and "| noise 0.25 px | " in text and "nan" not in text


def test_figures_are_medians_of_errors_and_means_of_shares() -> None:
    f = estimators.figures([PERFECT, PERFECT | {"ms": 30.0}, ABSENT, ABSENT])
    assert f["n"] == 4 and f["rho"] == 0.5 and f["ms"] == 10
    assert all(f[name] == 0.5 for name in ("success", "pose < 10 deg", "AUC@10", "inliers"))
