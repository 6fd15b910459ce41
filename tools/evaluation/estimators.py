"""Compare estimators of F, with and without the order of the ends, on synthetic smears.

``python -m tools.evaluation.estimators --out tools/results/estimators.md`` changes one factor at a time
(`CELLS`); ``--first-seed 10000`` takes other seeds, to choose options on. Every method gets the same matches
in the same process, one after the other, with one thread; times are CPU times of single calls.
"""

import time
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from functools import cache, partial
from importlib import metadata
from typing import Any, get_args

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.geometry.epipolar import serrmin
from tools.command import Target, mapped, publish, run, table
from tools.datasets.synthetic_matches import Kind, KnownMatches, SyntheticOptions, synthetic_smears
from tools.evaluation.baselines import METHODS, PAPER
from tools.evaluation.benchmark import machine
from tools.metrics import NO_POSE_DEG, PAPER_INLIER, epipole_angle_deg, pose_auc, pose_error_deg, rho

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
"""What a cell changes in the base case: 30 % random outliers, 1 px, 20 px smears, mixed motion."""
TUNING_SEED = 10_000  # first of the seeds that options may be chosen on; the tables are of seeds from 0
SUCCESS_RHO = 0.05  # median rho below which an F counts as found: off by a twentieth of the smears' length
WORST = {"rho": 1, "under_05": 0, "under_10": 0, "inliers": 0, "epipole_deg": 90, "pose_deg": NO_POSE_DEG}
FIGURES: dict[str, tuple[int, str, Callable[[AnyArray], Any]]] = {
    "n": (0, "rho", len),
    "success": (3, "rho", lambda column: (column < SUCCESS_RHO).mean()),
    **{f"AUC@{bound}": (3, "pose_deg", partial(pose_auc, bound_deg=bound)) for bound in (5, 10, 20)},
    "rho": (4, "rho", np.median),
    "rho < 0.05": (3, "under_05", np.mean),
    "rho < 0.10": (3, "under_10", np.mean),
    "inliers": (3, "inliers", np.mean),
    "epipole, deg": (2, "epipole_deg", np.median),
    "ms": (1, "ms", np.median),
}
"""A method's figures over instances: digits, the measure of an instance (`judge`), and its statistic."""

Key = tuple[str, Kind, int]
"""Cell, kind of depth and seed of an instance."""
Measured = dict[str, dict[str, float]]
"""By method, how good its F of an instance is."""


def judge(F: AnyArray | None, problem: KnownMatches, F_true: AnyArray | None = None) -> dict[str, float]:
    """Return how good an F is on true smears, for the true K, F and pose; None is the worst answer.

    The median of ``rho``; shares of smears with a rho below 0.05 and 0.10, and of the paper's inliers; the
    angle of the epipoles and the error of the pose (NaN without a true one), both up to the flip of time.
    """
    if F is None:
        return WORST
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


def by_method(instances: Sequence[Measured]) -> dict[str, dict[str, float]]:
    """Return the `FIGURES` of every method over instances."""
    found = {}
    for name in dict.fromkeys(name for one in instances for name in one):
        rows = [one[name] for one in instances if name in one]
        figures = {title: make(np.array([r[key] for r in rows])) for title, (_, key, make) in FIGURES.items()}
        found[name] = figures
    return found


def method_table(instances: Sequence[Measured]) -> list[str]:
    """Return a table with a row for each method."""
    digits = [count for count, *_ in FIGURES.values()]
    rows = (
        [name, *(f"{value:.{count}f}" for value, count in zip(found.values(), digits, strict=True))]
        for name, found in by_method(instances).items()
    )
    return table(f"method | {' | '.join(FIGURES)}", rows)


def cell_table(records: Mapping[Key, Measured], kind: str) -> list[str]:
    """Return a table with a row for each cell, a column for each method."""
    rows = []
    for cell in CELLS:
        of = by_method([one for key, one in records.items() if key[:2] == (cell, kind)])
        cells = (f"{of[n]['AUC@10']:.2f} / {of[n]['success']:.2f}" if n in of else "" for n in METHODS)
        rows.append([cell, *cells])
    return table(f"cell | {' | '.join(METHODS)}", rows)


@cache
def warm_up() -> None:
    """Let every library load and allocate before it is timed."""
    measured(synthetic_smears(TUNING_SEED), METHODS.keys() - {PAPER})


def run_instance(key: Key, paper_seeds: range) -> Measured:
    """Return how good every method is for a cell, a kind of depth and a seed."""
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
    *, seeds: int = 40, first_seed: int = 0, paper_seeds: int = 3, jobs: int = 2, out: Target | None = None
) -> None:
    """Run ``seeds`` seeds of every cell and kind; the paper's method (6 to 7 s each) runs ``paper_seeds``."""
    numbers = range(first_seed, first_seed + seeds)
    keys = [(cell, kind, seed) for seed in numbers for cell in CELLS for kind in KINDS]
    work = partial(run_instance, paper_seeds=range(first_seed, first_seed + paper_seeds))
    records = dict(zip(keys, mapped(work, keys, jobs), strict=True))
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in LIBRARIES)
    publish(out, f"{machine()}; {versions}.", *blocks(records))


if __name__ == "__main__":
    run(main)
