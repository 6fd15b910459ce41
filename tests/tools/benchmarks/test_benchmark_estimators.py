"""The estimators' comparison: what is run, that a killed run goes on, and what the tables say."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tools.benchmarks import benchmark_estimators as benchmark
from tools.benchmarks import estimator_methods, estimator_report
from tools.benchmarks.estimator_cells import CELLS, HARD, Instance, Measured, Plan, Record, synthetic_problem
from tools.benchmarks.estimator_methods import METHODS, OURS, PAPER, PYCOLMAP_NAME
from tools.pages import begun

EASY = Instance(seed=0, cell="noise 0.25 px", kind="scattered")
PERFECT = Measured(
    rho=0.0, under_05=1.0, under_10=1.0, inliers=1.0, serrmin_px2=0.0, epipole_deg=0.0, pose_deg=0.0, ms=10.0,
)  # fmt: skip
ABSENT = replace(PERFECT, rho=1.0, under_05=0.0, under_10=0.0, inliers=0.0, pose_deg=180.0)


def record(cell: str, seed: int, kind: str = "smooth") -> Record:
    rows = {OURS: PERFECT, PYCOLMAP_NAME: replace(PERFECT, ms=20.0)}
    return Record(instance=Instance(seed=seed, cell=cell, kind=kind), measured=rows)


def test_a_plan_has_every_cell_in_both_kinds_and_the_slow_method_on_the_first_seeds_alone() -> None:
    counts = Counter((instance.cell, instance.kind) for instance in Plan().instances())
    assert counts == {(c, kind): 100 if c == HARD else 40 for c in CELLS for kind in estimator_report.KINDS}
    truthful = {cell for cell in CELLS if Instance(seed=0, cell=cell, kind="smooth").truthful}
    assert len(CELLS) - len(truthful) == 5 and not any("stated" in cell for cell in truthful)
    plan = Plan(paper_seeds=2, first_seed=7)
    assert [k for k in range(7, 12) if plan.wants(PAPER, replace(EASY, seed=k))] == [7, 8]
    assert plan.wants(OURS, replace(EASY, seed=99)) and plan.wants(PAPER, plan.photographs(3)[0])


@pytest.mark.parametrize("name", [name for name in METHODS if name != PAPER])
def test_method_runs_and_is_judged(name: str) -> None:
    problem = synthetic_problem(EASY)
    measured = benchmark.measure(METHODS[name], problem)
    assert measured.ms > 0 and 0 <= measured.rho <= 1 and 0 <= measured.pose_deg <= 180
    if name == OURS or name in estimator_methods.TRUE_ORDER:
        assert measured.rho < 0.01 and measured.pose_deg < 10
    worst = benchmark.measure(lambda _: None, problem)
    assert worst.rho == 1 and worst.pose_deg == 180


@pytest.mark.slow
def test_a_run_logs_every_instance_that_is_not_done_and_forgets_half_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Plan, "instances", lambda _: iter([EASY, replace(EASY, seed=1)]))
    path, done = tmp_path / "a" / "log.jsonl", record("noise 0.25 px", 1, "scattered")
    head = {"code": "one"}
    monkeypatch.setattr(benchmark, "head", lambda: head)
    line = json.dumps(done.document()) + "\n"
    assert begun(path, head) == []
    path.write_text(path.read_text() + line + line[:50])
    benchmark.run(path, Plan(paper_seeds=0), 1, None)
    first, added = map(Record.of, begun(path, head))
    assert first == done and added.instance == EASY and set(added.measured) == set(METHODS) - {PAPER}
    with pytest.raises(SystemExit, match="was begun with"):
        begun(path, {"code": "two"})


def test_tables_and_answers_say_what_was_measured() -> None:
    f = estimator_report.figures([PERFECT, replace(PERFECT, ms=30.0), ABSENT, ABSENT])
    assert f["n"] == 4 and f["rho"] == 0.5 and f["ms"] == 10
    assert all(f[name] == 0.5 for name in ("success", "pose < 10 deg", "AUC@10", "inliers"))
    records = [record("base", seed, kind) for seed in range(2) for kind in estimator_report.KINDS]
    hard = record(HARD, 0)
    hard.measured[PAPER] = replace(ABSENT, ms=5000.0)
    records += [hard, record("network", 0, "network")]
    text = estimator_report.markdown(records, {"code": "one", "machine": "here"})
    assert "whole sweep: AUC@10 ours 1.000, best ordered 1.000 (true order, pycolmap)" in text
    assert "smooth, base: time over that of true order, pycolmap: median 0.50, p95 0.50" in text
    assert "500 times faster in the median; success 1 against 0" in text
    assert f"{HARD}, smooth: AUC@10 ours 1.000" in text
    assert "## Network smears: 1 rendered photographs" in text and "| ours | 3 | 1.000 |" in text
    assert "| ours | 2 | 1.000 |" in text and "code one" in text


def test_unordered_ends_do_not_come_in_true_order() -> None:
    problem = synthetic_problem(EASY)
    seen: list[np.ndarray] = []

    def solver(points1: np.ndarray, points2: np.ndarray) -> None:
        seen.append(np.stack([points1, points2], axis=1))

    assert estimator_methods.told(solver)(problem) is None
    for order in (estimator_methods.scrambled, estimator_methods.rightward):
        assert estimator_methods.rival(solver, order)(problem) is None
    np.testing.assert_array_equal(seen[0], problem.ordered)
    assert 0.4 < (seen[1] == problem.ordered).all(axis=(1, 2)).mean() < 0.6
    assert (seen[2][:, 1, 0] >= seen[2][:, 0, 0]).all()
