"""Write tools/results/paper.md: the paper's experiments on rendered photographs, beside what it published.

``python -m tools.paper.paper_report`` reads what is in RESULTS (`experiments` makes it) and says of what is
missing by which command it is made.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tools.arguments import parser_of
from tools.paper import failure_cases, paper_summary, paper_tables
from tools.paper.paper_variants import ALPHA_STUDY, TABLE_1
from tools.rendering.failure_scenes import KINDS

RESULTS = Path("tools/results")
TRAINING = (
    "python -m tools.paper.paper_variants --train render/train --val render/val --out runs/paper/variants"
)
REPORT = "python -m tools.paper.experiments --stages report"
TABLE_2 = "python -m tools.paper.paper_tables render/test --out tools/results/paper_table2"
FAILURES = "python -m tools.paper.failure_cases --photos KODAK --out tools/results/paper_failures.json"
CONVOLUTION = (
    "python -m tools.paper.convolution_blur --photos KODAK --out tools/results/figures/convolution.png"
)
FIGURES = "python -m tools.reports.figures render/test --photos KODAK"
EVALUATION = "python -m tools.evaluation.evaluate render/test --out tools/results/evaluation"


@dataclass(frozen=True, kw_only=True)
class Published:
    """What the paper reports of one dataset: EPE-S of the top 50 %; inliers of its F and of the true F, %."""

    dataset: str
    epe_s_px: float
    inliers: float
    inliers_true: float


PUBLISHED = (
    Published(dataset="Monkaa", epe_s_px=0.829, inliers=42.25, inliers_true=60.45),
    Published(dataset="Driving", epe_s_px=10.405, inliers=32.35, inliers_true=70.28),
    Published(dataset="GoPro", epe_s_px=0.996, inliers=30.21, inliers_true=58.10),
    Published(dataset="RBI", epe_s_px=2.389, inliers=34.62, inliers_true=59.39),
)

INTRODUCTION = """# The paper's experiments, on our data

The paper: *Robust Fundamental Matrix Estimation from Single Image Motion Blur* (Tran, Forssén, Viksten,
arXiv 2605.01552). None of its datasets is in this repository, so **its figures and ours are of different
photographs**: ours are rendered (`tools/datasets/testset.py`, `tools/datasets/shards.py`). What can be
compared are fractions
of what the true F reaches, and which variant is best. People who have its datasets run the same commands on
them after `python -m tools.datasets --kind monkaa ...` (`help('tools.datasets')`: layouts, licences).

`python -m tools.paper.experiments --photos KODAK` makes all of this file: about three hours of two cores,
two of them for
the 33 trainings of Table 1 and of the study of alpha; a stopped run goes on."""


def read(results: Path, name: str) -> Any:
    """Return a stored result; None if there is none."""
    path = results / name
    return json.loads(path.read_text()) if path.exists() else None


def missing(command: str, budget: str) -> list[str]:
    """Return how a missing part is made."""
    return [f"Not run yet. `{command}` makes it ({budget})."]


def comparison(table2: Any, evaluation: Any) -> list[str]:
    """Return our figures under the published ones."""
    lines = [
        "| photographs | EPE-S top 50 %, px | over the length | SErrMin < 3, F | true F | fraction |",
        "|---|---|---|---|---|---|",
    ]
    for p in PUBLISHED:
        fraction = p.inliers / p.inliers_true
        shares = f"{p.inliers / 100:.3f} | {p.inliers_true / 100:.3f} | {fraction:.2f}"
        lines.append(f"| {p.dataset}, as published | {p.epe_s_px:.3f} | - | {shares} |")
    smears = (evaluation or {}).get("smears", {})
    errors = [f"{smears[k]:.3f}" if k in smears else "-" for k in ("epe_s_top50", "epe_s_top50_over_length")]
    rows = {(r["estimator"], r["beta"]): r for r in (table2 or {}).get("rows", [])}
    ours, true = rows.get(("ours", paper_tables.AUTOMATIC)), rows.get(("true F", "-"))
    shares = "- | - | -"
    if ours and true:
        shares = f"{ours['inliers']:.3f} | {true['inliers']:.3f} | {ours['inliers_of_true']:.2f}"
    lines.append(f"| rendered test split, ours | {' | '.join(errors)} | {shares} |")
    return [
        *lines,
        "",
        "The paper's vector s is half of a smear; our EPE-S is of whole smears.",
        f"Ours: `{EVALUATION}` and Table 2 below.",
    ]


def first_table(document: Any) -> list[str]:
    """Return Table 1."""
    if document is None:
        return missing(TRAINING, "about 6.5 minutes of one core for each of 24 runs")
    found = paper_summary.from_stored(document)
    return [
        *paper_summary.table(found, TABLE_1),
        "",
        *paper_summary.verdicts(found),
        "",
        "![sparsification of the variants](paper_table1.png)",
        "",
        "Mean ± deviation over seeds, on 128 fixed crops of held-out textures. " + made_by_training(),
    ]


def alpha_study(document: Any) -> list[str]:
    """Return the study of alpha."""
    if not document:
        return missing(TRAINING, "about 6.5 minutes of one core for each of 12 runs, 3 of them of Table 1")
    found = paper_summary.from_stored(document)
    return [
        *paper_summary.table(found, ALPHA_STUDY),
        "",
        "Over the seeds that all four have. " + made_by_training(),
    ]


def made_by_training() -> str:
    """Return how any row of the tables of trainings is made."""
    return f"Made by `{TRAINING}`, one row alone with `--only` and its name, and `{REPORT}`."


def second_table(document: Any) -> list[str]:
    """Return Table 2 with its verdict."""
    if document is None:
        return missing(TABLE_2, "11 minutes of one core, nearly all for the paper's estimator")
    rows = [paper_tables.Row(**(row | {"curve": tuple(row["curve"])})) for row in document["rows"]]
    return [
        *paper_tables.markdown(rows),
        "",
        automatic_verdict(rows),
        "",
        "![cumulative SErrMin of both estimators](paper_table2.png)",
        "",
        f"Network {document['model_id']}. Made by `{TABLE_2}` (11 minutes of one core).",
    ]


def automatic_verdict(rows: Sequence[paper_tables.Row]) -> str:
    """Return whether choosing automatically is as good as the best fixed share."""
    ours = {row.beta: row for row in rows if row.estimator == "ours"}
    chosen = ours.pop(paper_tables.AUTOMATIC)
    shares, medians = max(r.inliers for r in ours.values()), min(r.serrmin_px2 for r in ours.values())
    words = [
        "at least as good as" if good else "worse than"
        for good in (chosen.inliers >= shares, chosen.serrmin_px2 <= medians)
    ]
    return (
        f"Choosing automatically is {words[0]} the best fixed share by inliers ({chosen.inliers:.3f}, "
        f"{shares:.3f}) and {words[1]} it by the median ({chosen.serrmin_px2:.3g}, {medians:.3g} px^2)."
    )


def failures(document: Any) -> list[str]:
    """Return the failure cases."""
    pictures = [f"![{kind}](figures/failure_{kind.replace(' ', '_')}.png)" for kind in KINDS]
    if document is None:
        return [*missing(FAILURES, "five minutes of two cores"), "", *pictures]
    seeds = next(iter(document["kinds"].values()))["images"]
    return [
        *failure_cases.markdown(document["kinds"]),
        "",
        "Not misled: of one plane and of a pure rotation no proven parallax; of many movers no F, "
        "several motions, or an F that fits what stands still (median rho below 0.1).",
        "",
        *pictures,
        "",
        f"Network {document['model_id']}. Made by `{FAILURES} --seeds {seeds}` and `{FIGURES}`.",
    ]


def convolution(document: Any) -> list[str]:
    """Return the comparison of both ways to blur."""
    if document is None:
        return missing(CONVOLUTION, "seconds")
    border, inner = document["difference_at_borders"], document["difference_inside"]
    return [
        f"Both blurs of one rendered scene differ by {border:.1f} levels of 255 in the mean within 8 px of "
        f"surfaces' edges ({document['border_share']:.0%} of the image) and by {inner:.1f} elsewhere.",
        "",
        "![blur by convolution and by averaging](figures/convolution.png)",
        "",
        f"Made by `{CONVOLUTION}`.",
    ]


def report(results: Path) -> str:
    """Return the whole file."""
    table1, table2 = read(results, "paper_table1.json"), read(results, "paper_table2.json")
    parts = {
        "Beside the published figures": comparison(table2, read(results, "evaluation.json")),
        "Table 1: losses and networks": first_table(table1),
        "Table 2: shares of the smears and estimators": second_table(table2),
        "Supplement: alpha": alpha_study(read(results, "paper_alpha.json")),
        "Supplement: blur by convolution": convolution(read(results / "figures", "convolution.json")),
        "Supplement: failure cases": failures(read(results, "paper_failures.json")),
    }
    sections = ["\n".join([f"## {title}", "", *lines]) for title, lines in parts.items()]
    return "\n\n".join([INTRODUCTION, *sections]) + "\n"


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS, help="(default: %(default)s)")
    arguments = parser.parse_args()
    (arguments.results / "paper.md").write_text(report(arguments.results))


if __name__ == "__main__":
    main()
