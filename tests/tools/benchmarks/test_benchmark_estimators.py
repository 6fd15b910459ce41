"""The estimators' comparison: what is run, that a killed run goes on, and what the tables say."""

from functools import partial
from pathlib import Path

import pytest

from tools.benchmarks import benchmark_estimators as benchmark
from tools.benchmarks.benchmark_estimators import synthetic_problem
from tools.estimators.baselines import METHODS, ORDERED, OURS, PAPER, PYCOLMAP_NAME
from tools.pages import Record, sweep

EASY = {"seed": 0, "cell": "noise 0.25 px", "kind": "scattered"}
PERFECT = {"rho": 0.0, "under_05": 1.0, "under_10": 1.0, "inliers": 1.0, "epipole_deg": 0.0, "pose_deg": 0.0}
PERFECT |= {"ms": 10.0}
ABSENT = PERFECT | {"rho": 1.0, "under_05": 0.0, "under_10": 0.0, "inliers": 0.0, "pose_deg": 180.0}


def record(cell: str, seed: int, kind: str = "smooth") -> Record:
    rows = {OURS: PERFECT, PYCOLMAP_NAME: PERFECT | {"ms": 20.0}}
    return {"seed": seed, "cell": cell, "kind": kind, "measured": rows}


@pytest.mark.parametrize("name", [name for name in METHODS if name != PAPER])
def test_method_runs_and_is_judged(name: str) -> None:
    problem = synthetic_problem(EASY)
    measured = benchmark.measure(METHODS[name], problem)
    assert measured["ms"] > 0 and 0 <= measured["rho"] <= 1 and 0 <= measured["pose_deg"] <= 180
    if name == OURS or name in ORDERED:
        assert measured["rho"] < 0.01 and measured["pose_deg"] < 10
    worst = benchmark.measure(lambda _: None, problem)
    assert worst["rho"] == 1 and worst["pose_deg"] == 180


@pytest.mark.slow
def test_a_run_goes_on_and_the_slow_method_has_its_seeds_alone(tmp_path: Path) -> None:
    path, done = tmp_path / "a" / "log.jsonl", record("noise 0.25 px", 1, "scattered")
    keys, work = [EASY | {"seed": 1}, EASY], partial(benchmark.run_instance, paper_seeds=range(1, 2))
    assert sweep(path, {"code": "one"}, keys[:1], lambda _: done) == [done]
    path.write_text(path.read_text() + path.read_text().splitlines()[1][:50])  # killed while writing
    first, added = sweep(path, {"code": "one"}, keys, work)
    assert (
        first == done and added.items() >= EASY.items() and set(added["measured"]) == set(METHODS) - {PAPER}
    )
    with pytest.raises(SystemExit, match="was begun with"):
        sweep(path, {"code": "two"}, keys, work)


def test_figures_are_medians_of_errors_and_means_of_shares() -> None:
    f = benchmark.figures("any", [PERFECT, PERFECT | {"ms": 30.0}, ABSENT, ABSENT])
    assert f["n"] == 4 and f["rho"] == 0.5 and f["ms"] == 10
    assert all(f[name] == 0.5 for name in ("success", "pose < 10 deg", "AUC@10", "inliers"))
