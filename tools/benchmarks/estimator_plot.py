"""The picture of the estimators' sweep: accuracy and time against every factor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tools.benchmarks.estimator_cells import BASE
from tools.benchmarks.estimator_log import Record
from tools.benchmarks.estimator_methods import OURS, PAPER
from tools.benchmarks.estimator_report import KINDS, Figures, by_method, select
from tools.reports.figure_style import new_figure, save

SHOWN = {
    OURS: ("C0", "o", 2.5),
    PAPER: ("C3", "x", 1.0),
    "two-parameter F": ("0.6", "v", 1.0),
    "u > 0 order, OpenCV MAGSAC": ("C5", "^", 1.0),
    "true order, OpenCV MAGSAC": ("C1", "s", 1.0),
    "true order, pycolmap": ("C2", "D", 1.0),
    "true order, PoseLib": ("C4", "P", 1.0),
}
"""Methods drawn: colour, marker, width of the line."""
MEASURES = {"AUC@10": "auc10", "median rho": "rho", "median ms": "ms"}
LOGARITHMIC = ("rho", "ms")
LEAST = 1e-4  # what a logarithmic axis shows for zero


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One factor: a label and the cells along it, with what stands below each."""

    label: str
    ticks: dict[str, str]


AXES = (
    Axis(
        label="random outliers, %",
        ticks={f"outliers {s}%": s for s in ("0", "15")} | {BASE: "30"}
        | {f"outliers {s}%": s for s in ("50", "60", "70")},
    ),
    Axis(
        label="second motion, %",
        ticks={"outliers 0%": "0"} | {f"second motion {s}%": s for s in ("15", "30", "45")},
    ),
    Axis(
        label="noise, px, stated truly",
        ticks={f"noise {s} px": s for s in ("0.25", "0.5")} | {BASE: "1", "noise 2 px": "2"},
    ),
    Axis(
        label="noise, px, stated as 1",
        ticks={f"noise {s} px, stated as 1": s for s in ("0.25", "0.5")}
        | {BASE: "1", "noise 2 px, stated as 1": "2"},
    ),
    Axis(
        label="smear, px",
        ticks={f"length {s} px": s for s in ("5", "10")} | {BASE: "20"}
        | {f"length {s} px": s for s in ("40", "60")},
    ),
    Axis(
        label="noise that varies, 1 px",
        ticks={
            BASE: "not", "noise varied": "stated", "noise varied, constant": "stated as\nmean",
            "noise varied, wrong": "stated\nwrongly",
        },
    ),
    Axis(
        label="motion",
        ticks={
            BASE: "mixed", "forward": "forward", "sideways": "sideways", "rotating": "rotating",
            "near-planar": "near-\nplanar",
        },
    ),
)  # fmt: skip


def plot(records: list[Record], path: Path) -> None:
    """Draw every measure against every factor, two rows of panels for each measure: smooth, scattered."""
    figure = new_figure(20, 16)
    panels = figure.subplots(len(MEASURES) * len(KINDS), len(AXES), squeeze=False, sharey="row")
    cells = dict.fromkeys(cell for axis in AXES for cell in axis.ticks)
    for k, kind in enumerate(KINDS):
        rows = {cell: by_method(select(records, cell=cell, kind=kind)) for cell in cells}
        for m, (name, field) in enumerate(MEASURES.items()):
            for column, axis in enumerate(AXES):
                panel = panels[len(KINDS) * m + k][column]
                _draw(panel, axis, rows, field)
                if field in LOGARITHMIC:
                    panel.set_yscale("log")
                if column == 0:
                    panel.set_ylabel(f"{name}\n{kind} depth")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(SHOWN))
    save(figure, path, dpi=60)


def _draw(panel: Any, axis: Axis, rows: dict[str, dict[str, Figures]], field: str) -> None:
    """Draw one measure of every method that is shown along one factor."""
    for method, (colour, marker, width) in SHOWN.items():
        at = [k for k, cell in enumerate(axis.ticks) if method in rows[cell]]
        values = [getattr(rows[cell][method], field) for cell in axis.ticks if method in rows[cell]]
        if field in LOGARITHMIC:
            values = [max(value, LEAST) for value in values]
        panel.plot(at, values, color=colour, marker=marker, linewidth=width, markersize=4, label=method)
    panel.set_xticks(range(len(axis.ticks)), list(axis.ticks.values()), fontsize=7)
    panel.set_xlim(-0.2, len(axis.ticks) - 0.8)
    panel.set_xlabel(axis.label)
    panel.grid(alpha=0.3)
