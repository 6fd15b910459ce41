"""The estimators' comparison: what is run, that a killed run goes on, and what the tables say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tools.benchmarks.estimator_log import Measured, Record, begun, read

from tools.benchmarks import benchmark_estimators as benchmark
from tools.benchmarks import estimator_methods, estimator_report
from tools.benchmarks.estimator_cells import CELLS, HARD, Instance, Plan, synthetic_problem
from tools.benchmarks.estimator_methods import METHODS, OURS, PAPER, PYCOLMAP_NAME
from tools.pages import append_line

EASY = Instance(seed=0, cell="noise 0.25 px", kind="scattered")
PERFECT = Measured(
    rho=0.0, under_05=1.0, under_10=1.0, inliers=1.0, serrmin_px2=0.0, epipole_deg=0.0, pose_deg=0.0,
    ms=10.0, found=1.0,
)  # fmt: skip
ABSENT = replace(PERFECT, rho=1.0, under_05=0.0, under_10=0.0, inliers=0.0, pose_deg=180.0, found=0.0)


def record(cell: str, seed: int, kind: str = "smooth") -> Record:
    rows = {OURS: PERFECT, PYCOLMAP_NAME: replace(PERFECT, ms=20.0)}
    return Record(instance=Instance(seed=seed, cell=cell, kind=kind), measured=rows)


def test_every_cell_has_its_seeds_in_both_kinds() -> None:
    counts: dict[tuple[str, str], int] = {}
    for instance in Plan().instances():
        counts[instance.cell, instance.kind] = counts.get((instance.cell, instance.kind), 0) + 1
    assert counts == {
        (cell, kind): 100 if cell == HARD else 40
        for cell in CELLS for kind in ("smooth", "scattered")
    }  # fmt: skip


def test_cells_that_misreport_are_not_truthful() -> None:
    told = {cell for cell in CELLS if Instance(seed=0, cell=cell, kind="smooth").truthful}
    wrong = {"noise 0.25 px, stated as 1", "noise 0.5 px, stated as 1", "noise 2 px, stated as 1"}
    assert set(CELLS) - told == wrong | {"noise varied, constant", "noise varied, wrong"}


@pytest.mark.parametrize("name", [name for name in METHODS if name != PAPER])
def test_method_runs_and_is_judged(name: str) -> None:
    problem = synthetic_problem(EASY)
    measured = benchmark.measure(METHODS[name], problem)
    assert measured.ms > 0 and 0 <= measured.rho <= 1 and 0 <= measured.pose_deg <= 180
    if name == OURS or name in estimator_methods.TRUE_ORDER:
        assert measured.found and measured.rho < 0.01 and measured.pose_deg < 10
    worst = benchmark.measure(lambda _: None, problem)
    assert not worst.found and worst.rho == 1 and worst.pose_deg == 180


def test_slow_method_runs_on_the_first_seeds_alone() -> None:
    plan = Plan(paper_seeds=2, first_seed=7)
    ran = [k for k in range(7, 12) if plan.wants(PAPER, replace(EASY, seed=k))]
    assert ran == [7, 8] and plan.wants(OURS, replace(EASY, seed=99))
    assert plan.photographs(3)[0].seed == 0 and plan.wants(PAPER, plan.photographs(3)[0])


def test_a_log_keeps_what_is_finished_and_forgets_half_a_line(tmp_path: Path) -> None:
    path, rows = tmp_path / "a" / "log.jsonl", [record("base", 0), record("base", 1)]
    assert read(path) == ({}, []) and begun(path, {"code": "one"}) == []
    for row in rows:
        append_line(path, row.document())
    path.write_text(path.read_text()[:-20])
    assert begun(path, {"code": "one"}) == rows[:1]
    append_line(path, rows[1].document())
    assert read(path) == ({"code": "one"}, rows)
    with pytest.raises(SystemExit, match="other code"):
        begun(path, {"code": "two"})


@pytest.mark.slow
def test_a_run_logs_every_instance_that_is_not_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Plan, "instances", lambda _: iter([EASY, replace(EASY, seed=1)]))
    path, plan = tmp_path / "log.jsonl", Plan(paper_seeds=0)
    begun(path, {"code": benchmark.code_digest()})
    append_line(path, record("noise 0.25 px", 1, "scattered").document())
    benchmark.run(path, plan, 1, None)
    done, added = read(path)[1]
    assert (
        done.instance.seed == 1 and added.instance == EASY and set(added.measured) == set(METHODS) - {PAPER}
    )


def test_figures_are_those_of_the_answers() -> None:
    f = estimator_report.figures([PERFECT, replace(PERFECT, ms=30.0), ABSENT, ABSENT])
    assert f["n"] == 4 and f["rho"] == 0.5 and f["ms"] == 10
    assert all(f[name] == 0.5 for name in ("success", "pose < 10 deg", "AUC@10", "inliers"))


def test_tables_and_answers_say_what_was_measured() -> None:
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

    for way in (estimator_methods.ordered, estimator_methods.unordered, estimator_methods.rightward):
        assert way(solver, problem) is None
    np.testing.assert_array_equal(seen[0], problem.ordered)
    assert 0.4 < (seen[1] == problem.ordered).all(axis=(1, 2)).mean() < 0.6
    assert (seen[2][:, 1, 0] >= seen[2][:, 0, 0]).all()
