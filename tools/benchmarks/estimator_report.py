"""Tables, figures and answers from the log of :mod:`tools.benchmarks.benchmark_estimators`."""

from collections.abc import Iterable

import numpy as np

from tools.benchmarks.estimator_cells import BASE, CELLS, HARD, NETWORK, Measured, Plan, Record
from tools.benchmarks.estimator_methods import METHODS, OURS, PAPER, PYCOLMAP_NAME, TRUE_ORDER
from tools.metrics import pose_auc
from tools.pages import table

SUCCESS_RHO = 0.05
"""Median rho below which an F counts as found: errors of exact smears under a twentieth of their length."""
POSE_DEG = (5.0, 10.0, 20.0)
KINDS = ("smooth", "scattered")
COLUMNS = {
    "n": "{:.0f}", "success": "{:.3f}", "pose < 10 deg": "{:.3f}", "AUC@5": "{:.3f}", "AUC@10": "{:.3f}",
    "AUC@20": "{:.3f}", "rho": "{:.4f}", "rho < 0.05": "{:.3f}", "rho < 0.10": "{:.3f}",
    "inliers": "{:.3f}", "epipole, deg": "{:.2f}", "ms": "{:.1f}", "p95 ms": "{:.1f}",
}  # fmt: skip
"""Figures of a method over many instances, as `introduction` explains them, and how they are written."""
Figures = dict[str, float]


def figures(measured: list[Measured]) -> Figures:
    """Return the COLUMNS of one method; the true F has every exact smear as an inlier."""
    column = {name: np.array([getattr(m, name) for m in measured]) for name in Measured.__dataclass_fields__}
    values = [
        len(measured),
        (column["rho"] < SUCCESS_RHO).mean(),
        (column["pose_deg"] < 10).mean(),
        *(pose_auc(column["pose_deg"], bound) for bound in POSE_DEG),
        np.median(column["rho"]),
        *(column[name].mean() for name in ("under_05", "under_10", "inliers")),
        np.median(column["epipole_deg"]),
        np.median(column["ms"]),
        np.quantile(column["ms"], 0.95),
    ]
    return {name: float(value) for name, value in zip(COLUMNS, values, strict=True)}


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
        base = select(chosen, cell=BASE)
        parts += [f"## Whole sweep, {kind} depth: {len(chosen)} instances", "", *method_table(chosen), ""]
        parts += [f"### Its base case: {len(base)} instances", "", *method_table(base), ""]
    if network:
        title = f"## Network smears: {len(network)} rendered photographs"
        parts += [title, "", *method_table(network), ""]
    for kind in KINDS:
        parts += [f"## Cell by cell, {kind} depth: AUC@10 / success", ""]
        parts += [*cell_table(select(synthetic, kind=kind)), ""]
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
- {PAPER}: the first {Plan.paper_seeds} seeds of every cell only; its rows are of those.
"""


def method_table(records: list[Record]) -> list[str]:
    """Return a table of all columns, one row for each method."""
    rows = by_method(records).items()
    cells = [(name, *(form.format(f[c]) for c, form in COLUMNS.items())) for name, f in rows]
    return table(f"method | {' | '.join(COLUMNS)}", cells)


def cell_table(records: list[Record]) -> list[str]:
    """Return a table with a row for each cell, a column for each method."""
    names, lines = list(by_method(records)), []
    for cell in CELLS:
        rows = by_method(select(records, cell=cell))
        cells = [f"{rows[n]['AUC@10']:.2f} / {rows[n]['success']:.2f}" if n in rows else "" for n in names]
        lines += [(cell, *cells)] if rows else []
    return table(f"cell | {' | '.join(names)}", lines)


def answers(records: list[Record]) -> list[str]:
    """Return lines that answer the questions of the comparison."""
    synthetic = select(records)
    kinds = {kind: select(synthetic, kind=kind) for kind in KINDS}
    lines = [
        against_ordered("whole sweep", synthetic),
        against_ordered("cells with truthful sigma", [r for r in synthetic if r.instance.truthful]),
        *(against_ordered(f"whole sweep, {kind}", chosen) for kind, chosen in kinds.items()),
        *(against_ordered(f"{HARD}, {kind}", select(chosen, cell=HARD)) for kind, chosen in kinds.items()),
        *(line for kind, chosen in kinds.items() for line in times(kind, chosen)),
        against_paper([r for r in synthetic if PAPER in r.measured]),
    ]
    return [f"- {line}" for line in lines if line]


def against_ordered(name: str, records: list[Record]) -> str:
    """Return how our AUC@10, success and poses compare with the best method's that is told the order."""
    rows = by_method(records)
    told = [method for method in TRUE_ORDER if method in rows]
    if OURS not in rows or not told:
        return ""
    parts = []
    for column in ("AUC@10", "success", "pose < 10 deg"):
        best, ours = max(told, key=lambda method: rows[method][column]), rows[OURS][column]
        parts.append(f"{column} ours {ours:.3f}, best ordered {rows[best][column]:.3f} ({best})")
    return f"{name}: {'; '.join(parts)}"


def times(kind: str, records: list[Record]) -> list[str]:
    """Return our time over every pycolmap's, on the whole sweep and the base case."""
    lines = []
    for name, chosen in (("whole sweep", records), (BASE, select(records, cell=BASE))):
        rows = by_method(chosen)
        for rival in (method for method in rows if method.startswith(PYCOLMAP_NAME)):
            ms, p95 = (rows[OURS][column] / rows[rival][column] for column in ("ms", "p95 ms"))
            lines.append(f"{kind}, {name}: time over that of {rival}: median {ms:.2f}, p95 {p95:.2f}")
    return lines


def against_paper(records: list[Record]) -> str:
    """Return how we compare with the paper's estimator on the instances that it ran on."""
    rows = by_method(records)
    if PAPER not in rows:
        return ""
    a, b = rows[OURS], rows[PAPER]
    pairs = [f"{name} {a[name]:.4g} against {b[name]:.4g}" for name in ("success", "AUC@10", "rho")]
    faster = f"{b['ms'] / a['ms']:.0f} times faster in the median"
    return f"against {PAPER} on {b['n']:.0f} instances: {faster}; {', '.join(pairs)}"
