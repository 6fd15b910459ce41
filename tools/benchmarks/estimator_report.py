"""Tables, figures and answers from the log of :mod:`tools.benchmarks.benchmark_estimators`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from tools.benchmarks.estimator_cells import BASE, CELLS, FULL, HARD, NETWORK
from tools.benchmarks.estimator_log import Measured, Record
from tools.benchmarks.estimator_methods import METHODS, OURS, PAPER, PYCOLMAP_NAME, TRUE_ORDER
from tools.evaluation.pose_error import pose_auc

SUCCESS_RHO = 0.05
"""Median rho below which an F counts as found: errors of exact smears under a twentieth of their length."""
POSE_DEG = (5.0, 10.0, 20.0)
KINDS = ("smooth", "scattered")


@dataclass(frozen=True, kw_only=True)
class Figures:
    """One method over many instances.

    ``success`` share with median rho under SUCCESS_RHO; ``posed`` share with a pose error under 10 degrees;
    ``rho``, ``epipole_deg``, ``ms`` medians over instances; ``rho_under_05``, ``rho_under_10`` and
    ``inliers_of_true`` means of shares of smears; ``auc5``, ``auc10``, ``auc20`` of the pose error.
    """

    instances: int
    success: float
    posed: float
    rho: float
    rho_under_05: float
    rho_under_10: float
    inliers_of_true: float
    epipole_deg: float
    auc5: float
    auc10: float
    auc20: float
    ms: float
    ms_p95: float


def figures(measured: list[Measured]) -> Figures:
    """Return the figures of one method; the true F has every exact smear as an inlier."""
    column = {name: np.array([getattr(m, name) for m in measured]) for name in Measured.__dataclass_fields__}
    auc5, auc10, auc20 = (pose_auc(column["pose_deg"], bound) for bound in POSE_DEG)
    return Figures(
        instances=len(measured),
        success=float((column["rho"] < SUCCESS_RHO).mean()),
        posed=float((column["pose_deg"] < 10).mean()),
        rho=float(np.median(column["rho"])),
        rho_under_05=float(column["under_05"].mean()),
        rho_under_10=float(column["under_10"].mean()),
        inliers_of_true=float(column["inliers"].mean()),
        epipole_deg=float(np.median(column["epipole_deg"])),
        auc5=auc5,
        auc10=auc10,
        auc20=auc20,
        ms=float(np.median(column["ms"])),
        ms_p95=float(np.quantile(column["ms"], 0.95)),
    )


def by_method(records: Iterable[Record]) -> dict[str, Figures]:
    """Return the figures of every method over records, in the order of METHODS, if it ever ran."""
    found: dict[str, list[Measured]] = {name: [] for name in METHODS}
    for record in records:
        for name, measured in record.measured.items():
            found[name].append(measured)
    return {name: figures(rows) for name, rows in found.items() if rows}


def select(records: Iterable[Record], cell: str | None = None, kind: str | None = None) -> list[Record]:
    """Return the records of a cell (None: of every synthetic cell) and a kind (None: of both)."""
    return [
        r
        for r in records
        if (r.instance.cell == cell if cell else r.instance.cell != NETWORK)
        and (kind is None or r.instance.kind == kind)
    ]


def markdown(records: list[Record], head: dict[str, str]) -> str:
    """Return everything as text: answers, both kinds over the sweep, network smears, every cell."""
    synthetic, network = select(records), select(records, cell=NETWORK)
    parts = [introduction(head), "## Answers", "", *answers(records), ""]
    for kind in KINDS:
        chosen = select(synthetic, kind=kind)
        parts += [f"## Whole sweep, {kind} depth: {len(chosen)} instances", "", *table(by_method(chosen)), ""]
        base = select(synthetic, cell=BASE, kind=kind)
        parts += [f"### Its base case: {len(base)} instances", "", *table(by_method(base)), ""]
    if network:
        parts += [
            f"## Network smears: {len(network)} rendered photographs",
            "",
            *table(by_method(network)),
            "",
        ]
    for kind in KINDS:
        parts += [f"## Cell by cell, {kind} depth", ""]
        for title, value in CELL_TABLES.items():
            parts += [f"{title}:", "", *cell_table(select(synthetic, kind=kind), value), ""]
    return "\n".join(parts)


def introduction(head: dict[str, str]) -> str:
    """Return what was measured, where and how to read it."""
    libraries = ", ".join(f"{k} {v}" for k, v in head.items() if k not in ("code", "machine"))
    return f"""# Estimators of F, ours without the order of any match

{head.get("machine", "")}; {libraries}; code {head.get("code", "")}.
Made by `python -m tools.benchmarks.benchmark_estimators`.

Base case: 1000 smears of 20 px, noise of 1 px in every coordinate of both ends, 30 % random outliers, mixed
motion, 640x480; one factor is changed at a time. Every method gets the same matches in the same process with
one thread; ms is the CPU time of one call. "true order" methods are given what a photograph does not show.

- success: share of instances with median rho (root SErrMin over length, on exact smears) under {SUCCESS_RHO}:
  counted as failures of F estimators usually are, by the error on true matches. Kind to an F from unordered
  matches, whose errors are bounded: so look at the pose as well.
- pose: the larger of the rotation's and the translation direction's error, from F and the true K by
  cheirality, the better flip of time, the same for every method; AUC as usual, no F counts as 180 degrees.
- rho, epipole, ms: medians over instances; shares and inliers: means. Inliers: SErrMin < 3 on exact smears,
  where the true F has all.
- {PAPER}: the first {FULL.paper_seeds} seeds of every cell only; its rows are of those.
"""


COLUMNS: dict[str, Callable[[Figures], str]] = {
    "n": lambda f: f"{f.instances}",
    "success": lambda f: f"{f.success:.3f}",
    "pose < 10 deg": lambda f: f"{f.posed:.3f}",
    "AUC@5": lambda f: f"{f.auc5:.3f}",
    "AUC@10": lambda f: f"{f.auc10:.3f}",
    "AUC@20": lambda f: f"{f.auc20:.3f}",
    "rho": lambda f: f"{f.rho:.4f}",
    "rho < 0.05": lambda f: f"{f.rho_under_05:.3f}",
    "rho < 0.10": lambda f: f"{f.rho_under_10:.3f}",
    "inliers": lambda f: f"{f.inliers_of_true:.3f}",
    "epipole, deg": lambda f: f"{f.epipole_deg:.2f}",
    "ms": lambda f: f"{f.ms:.1f}",
    "p95 ms": lambda f: f"{f.ms_p95:.1f}",
}
CELL_TABLES: dict[str, Callable[[Figures], str]] = {
    "AUC@10 / success": lambda f: f"{f.auc10:.2f} / {f.success:.2f}",
    "Median rho": lambda f: f"{f.rho:.4f}",
    "Median / p95 ms": lambda f: f"{f.ms:.0f} / {f.ms_p95:.0f}",
}


def table(rows: dict[str, Figures]) -> list[str]:
    """Return a table of all columns, one row for each method."""
    lines = ["| method | " + " | ".join(COLUMNS) + " |", "|---|" + "---|" * len(COLUMNS)]
    for name, f in rows.items():
        lines.append(f"| {name} | " + " | ".join(column(f) for column in COLUMNS.values()) + " |")
    return lines


def cell_table(records: list[Record], value: Callable[[Figures], str]) -> list[str]:
    """Return a table with a row for each cell, a column for each method."""
    names = list(by_method(records))
    lines = ["| cell | " + " | ".join(names) + " |", "|---|" + "---|" * len(names)]
    for cell in CELLS:
        rows = by_method(select(records, cell=cell))
        if rows:
            cells = [value(rows[name]) if name in rows else "" for name in names]
            lines.append(f"| {cell} | " + " | ".join(cells) + " |")
    return lines


def answers(records: list[Record]) -> list[str]:
    """Return lines that answer the questions of the comparison."""
    synthetic = select(records)
    truthful = [r for r in synthetic if r.instance.truthful]
    lines = [
        against_ordered("whole sweep", synthetic),
        against_ordered("cells with truthful sigma", truthful),
    ]
    lines += [against_ordered(f"whole sweep, {kind}", select(synthetic, kind=kind)) for kind in KINDS]
    lines += [line for kind in KINDS for line in times(kind, select(synthetic, kind=kind))]
    lines += against_paper([r for r in synthetic if PAPER in r.measured])
    lines += [success_when_hard(kind, select(records, cell=HARD, kind=kind)) for kind in KINDS]
    return [f"- {line}" for line in lines if line]


def against_ordered(name: str, records: list[Record]) -> str:
    """Return how our AUC@10 and success compare with the best true-order method's."""
    rows = by_method(records)
    if OURS not in rows:
        return ""
    f, ordered = rows[OURS], {method: rows[method] for method in TRUE_ORDER if method in rows}
    best = max(ordered, key=lambda method: ordered[method].auc10)
    surest = max(ordered, key=lambda method: ordered[method].success)
    return (
        f"{name}: AUC@10 ours {f.auc10:.3f}, best ordered {ordered[best].auc10:.3f} ({best}), "
        f"{f.auc10 - ordered[best].auc10:+.3f}; success ours {f.success:.3f}, "
        f"best ordered {ordered[surest].success:.3f} ({surest}), {f.success - ordered[surest].success:+.3f}; "
        f"pose under 10 degrees ours {f.posed:.3f}, best ordered {max(t.posed for t in ordered.values()):.3f}"
    )


def times(kind: str, records: list[Record]) -> list[str]:
    """Return our time over every pycolmap's, on the whole sweep and the base case."""
    lines = []
    for name, chosen in (("whole sweep", records), (BASE, select(records, cell=BASE))):
        rows = by_method(chosen)
        for rival in (method for method in rows if method.startswith(PYCOLMAP_NAME)):
            ms, p95 = rows[OURS].ms / rows[rival].ms, rows[OURS].ms_p95 / rows[rival].ms_p95
            lines.append(f"{kind}, {name}: time over that of {rival}: median {ms:.2f}, p95 {p95:.2f}")
    return lines


def against_paper(records: list[Record]) -> list[str]:
    """Return how we compare with the paper's estimator on the instances that it ran on."""
    rows = by_method(records)
    if PAPER not in rows:
        return []
    a, b = rows[OURS], rows[PAPER]
    return [
        f"against {PAPER} on {b.instances} instances: {b.ms / a.ms:.0f} times faster in the median; success "
        f"{a.success:.3f} against {b.success:.3f}, AUC@10 {a.auc10:.3f} against {b.auc10:.3f}, "
        f"median rho {a.rho:.4f} against {b.rho:.4f}"
    ]


def success_when_hard(kind: str, records: list[Record]) -> str:
    """Return the success at 60 % random outliers."""
    rows = by_method(records)
    if OURS not in rows:
        return ""
    f = rows[OURS]
    return f"{kind}, {HARD}, 1 px, 20 px: ours succeeds in {f.success:.1%} of {f.instances} seeds"
