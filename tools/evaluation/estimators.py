"""Compare estimators of F, with and without the order of the ends, on synthetic smears.

``python -m tools.evaluation.estimators`` sweeps one factor at a time (`CELLS`) and writes the tables of
``tools/results/estimators.md``; ``--first-seed 10000`` takes other seeds, to tune on. Every method gets the
same matches in the same process, one after the other, with one thread; times are CPU times of single calls.
"""

import time
from collections.abc import Container, Iterator, Mapping, Sequence
from functools import cache, partial
from importlib import metadata
from pathlib import Path
from typing import Any, get_args

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.geometry.epipolar import serrmin
from tools.arguments import Target, run
from tools.datasets.synthetic_matches import Kind, KnownMatches, SyntheticOptions, synthetic_smears
from tools.evaluation.baselines import METHODS, PAPER
from tools.evaluation.benchmark import machine
from tools.metrics import NO_POSE_DEG, PAPER_INLIER, epipole_angle_deg, pose_auc, pose_error_deg, rho
from tools.pages import fill, joined, table
from tools.processes import mapped

LIBRARIES = ("numpy", "opencv-contrib-python-headless", "pycolmap", "poselib")
KINDS: tuple[Kind, ...] = get_args(Kind)
CELLS: dict[str, dict[str, Any]] = {
    "base": {},
    **{f"outliers {share:.0%}": {"outliers": share} for share in (0.0, 0.15, 0.5, 0.6, 0.7)},
    **{f"second motion {s:.0%}": {"outliers": 0.0, "second_motion": s} for s in (0.15, 0.3, 0.45)},
    **{f"noise {px:g} px": {"noise_px": px} for px in (0.25, 0.5, 2.0)},
    **{f"noise {px:g} px, stated as 1": {"noise_px": px, "report": "constant"} for px in (0.25, 0.5, 2.0)},
    **{f"noise {report}": {"report": report} for report in ("varied", "varied, constant", "varied, wrong")},
    **{f"length {px:g} px": {"length_px": px} for px in (5.0, 10.0, 40.0, 60.0)},
    **{m: {"motion": m} for m in ("forward", "sideways", "rotating", "near-planar")},
}
"""What every cell changes in the base case: 30 % random outliers, 1 px, 20 px smears, mixed motion."""
TUNING_SEED = 10_000  # first of the seeds that options may be tuned on; the tables are of seeds from 0
SUCCESS_RHO = 0.05
"""Median rho below which an F counts as found: errors of exact smears under a twentieth of their length."""
HEAD = (
    "method | n | success | AUC@5 | AUC@10 | AUC@20 | rho | rho < 0.05 | rho < 0.10 | inliers "
    "| epipole, deg | ms"
)
PAGE = Path(__file__).resolve().parents[1] / "results/estimators.md"

Key = tuple[str, Kind, int]
"""Cell, kind of depth and seed of an instance."""
Measured = dict[str, dict[str, float]]
"""The figures of every method in one instance."""


def judge(F: AnyArray | None, problem: KnownMatches, F_true: AnyArray | None = None) -> dict[str, float]:
    """Return how good an F is on true smears, for the true K, F and pose; None is the worst answer.

    The median of ``rho``; shares of smears with a rho below 0.05 and 0.10, and of the paper's inliers; the
    angle of the epipoles and the error of the pose (NaN where none is known), both up to the flip of time.
    """
    if F is None:
        worst = {"rho": 1.0, "under_05": 0.0, "under_10": 0.0, "inliers": 0.0}
        return worst | {"epipole_deg": 90.0, "pose_deg": NO_POSE_DEG}
    K, R, t, relative = problem.K, problem.R, problem.t, rho(F, problem.true_ends)
    has_pose = np.isfinite(R).all()
    return {
        "rho": float(np.median(relative)),
        "under_05": float((relative < 0.05).mean()),
        "under_10": float((relative < 0.10).mean()),
        "inliers": float((serrmin(F, problem.true_ends) < PAPER_INLIER).mean()),
        "epipole_deg": epipole_angle_deg(F, problem.F if F_true is None else F_true, K),
        "pose_deg": pose_error_deg(F, K, R, t, problem.matches.ends) if has_pose else float("nan"),
    }


def measured(problem: KnownMatches, names: Container[str], F_true: AnyArray | None = None) -> Measured:
    """Return how good the F of each method is, and its CPU time in milliseconds."""
    found = {}
    for name in METHODS:
        if name in names:
            start = time.process_time()
            F = METHODS[name](problem)
            ms = 1e3 * (time.process_time() - start)
            found[name] = judge(F, problem, F_true) | {"ms": ms}
    return found


@cache
def warm_up() -> None:
    """Let every library load and allocate before it is timed."""
    measured(synthetic_smears(TUNING_SEED), METHODS.keys() - {PAPER})


def figures(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the figures of one method over instances, in the order of HEAD."""
    column = {key: np.array([one[key] for one in rows]) for key in rows[0]}
    return {
        "n": len(rows),
        "success": (column["rho"] < SUCCESS_RHO).mean(),
        **{f"AUC@{bound}": pose_auc(column["pose_deg"], bound) for bound in (5, 10, 20)},
        "rho": np.median(column["rho"]),
        **{key: column[key].mean() for key in ("under_05", "under_10", "inliers")},
        **{key: np.median(column[key]) for key in ("epipole_deg", "ms")},
    }


def by_method(instances: Sequence[Measured]) -> dict[str, dict[str, float]]:
    """Return the figures of every method over instances."""
    names = dict.fromkeys(name for one in instances for name in one)
    return {name: figures([one[name] for one in instances if name in one]) for name in names}


def method_table(instances: Sequence[Measured]) -> list[str]:
    """Return a table with a row for each method."""
    digits = (0, 3, 3, 3, 3, 4, 3, 3, 3, 2, 1)
    rows = (
        [name, *(f"{value:.{n}f}" for value, n in zip(found.values(), digits, strict=True))]
        for name, found in by_method(instances).items()
    )
    return table(HEAD, rows)


def cell_table(records: Mapping[Key, Measured], kind: str) -> list[str]:
    """Return a table with a row for each cell, a column for each method."""
    names, rows = list(METHODS), []
    for cell in CELLS:
        of = by_method([one for key, one in records.items() if key[:2] == (cell, kind)])
        cells = (f"{of[n]['AUC@10']:.2f} / {of[n]['success']:.2f}" if n in of else "" for n in names)
        rows.append([cell, *cells])
    return table(f"cell | {' | '.join(names)}", rows)


def run_instance(key: Key, paper_seeds: range) -> Measured:
    """Return the figures of every method for a cell, a kind of depth and a seed."""
    warm_up()
    cell, kind, seed = key
    problem = synthetic_smears(seed, SyntheticOptions(kind=kind, **CELLS[cell]))
    return measured(problem, METHODS if seed in paper_seeds else METHODS.keys() - {PAPER})


def blocks(records: Mapping[Key, Measured]) -> Iterator[str | list[str]]:
    """Yield the page's parts: all cells together, and every cell, of both kinds of depth."""
    for kind in KINDS:
        rows = [one for key, one in records.items() if key[1] == kind]
        yield from (f"## Whole sweep, {kind} depth", method_table(rows))
    for kind in KINDS:
        yield from (f"## Cell by cell, {kind} depth: AUC@10 / success", cell_table(records, kind))


def main(
    *, seeds: int = 40, first_seed: int = 0, paper_seeds: int = 3, jobs: int = 2, out: Target = PAGE
) -> None:
    """Run so many seeds of every cell and kind, and write the tables.

    The paper's estimator takes 6 to 7 s for one instance and has ``paper_seeds``.
    """
    numbers = range(first_seed, first_seed + seeds)
    keys = [(cell, kind, seed) for seed in numbers for cell in CELLS for kind in KINDS]
    slow = range(first_seed, first_seed + paper_seeds)
    records = dict(zip(keys, mapped(partial(run_instance, paper_seeds=slow), keys, jobs), strict=True))
    made = f"{machine()}; {', '.join(f'{name} {metadata.version(name)}' for name in LIBRARIES)}.\n"
    fill(PAGE, {"run": made, "tables": joined(*blocks(records))}, out)


if __name__ == "__main__":
    run(main)
