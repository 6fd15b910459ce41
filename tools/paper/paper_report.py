"""The text of tools/results/paper.md: the experiments on rendered photographs, beside what was published."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tools.pages import table
from tools.paper import paper_tables
from tools.paper.paper_variants import ALPHA_STUDY, SIX, VARIANTS, Variant

MEASURES = (
    "epe_s_top50", "epe_s_top50_over_length", "sparsification_area", "epe_s_left", "epe_s_oracle",
    "direction_deg_top50",
)  # fmt: skip
HEAD = (
    "name | loss | alpha | steps | seeds | EPE-S top 50 %, px | over the length "
    "| sparsification area | EPE-S left, px | oracle, px | direction top 50 %, deg"
)
RANKED = {
    "epe_s_top50": "EPE-S top 50 %",
    "sparsification_area": "sparsification area",
    "epe_s_left": "EPE-S left (mean over all shares removed by sigma)",
}
BEST = "stem_double_map_0.01"  # the variant that the paper found best
COMMAND = "python -m tools.paper.experiments --photos KODAK --stages"
EVALUATION = "python -m tools.evaluation.evaluate render/test --out tools/results/evaluation"
PUBLISHED = (
    ("Monkaa", 0.829, 42.25, 60.45),
    ("Driving", 10.405, 32.35, 70.28),
    ("GoPro", 0.996, 30.21, 58.10),
    ("RBI", 2.389, 34.62, 59.39),
)
"""What the paper reports of a dataset: EPE-S of the top 50 %, px; inliers of its F and of the true F, %."""

INTRODUCTION = """# The paper's experiments, on our data

The paper: *Robust Fundamental Matrix Estimation from Single Image Motion Blur* (Tran, Forssén, Viksten,
arXiv 2605.01552). None of its datasets is in this repository, so **its figures and ours are of different
photographs**: ours are rendered (`tools/datasets/testset.py`, `tools/datasets/shards.py`). What can be
compared are fractions of what the true F reaches, and which variant is best.

`python -m tools.paper.experiments --photos KODAK` makes all of this file: about three hours of two cores, two
of them for the 27 trainings of Table 1 and of the study of alpha; finished seeds are kept."""


@dataclass(frozen=True, kw_only=True)
class VariantFigures:
    """One variant over its seeds: means and standard deviations by measure."""

    name: str
    seeds: int
    steps: int
    mean: dict[str, float]
    deviation: dict[str, float]


def figures_of(name: str, documents: Sequence[dict[str, Any]]) -> VariantFigures:
    """Return the averaged results of one variant."""
    values = {measure: [float(d[measure]) for d in documents] for measure in MEASURES}
    return VariantFigures(
        name=name,
        seeds=len(documents),
        steps=int(documents[0]["steps"]),
        mean={measure: float(np.mean(v)) for measure, v in values.items()},
        deviation={measure: float(np.std(v)) for measure, v in values.items()},
    )


def read_runs(folder: Path, variants: Iterable[Variant]) -> dict[str, VariantFigures]:
    """Return what is finished of variants, by name."""
    paths = {variant.name: sorted(folder.glob(f"{variant.name}_[0-9]*.json")) for variant in variants}
    documents = {name: [json.loads(path.read_text()) for path in found] for name, found in paths.items()}
    return {name: figures_of(name, found) for name, found in documents.items() if found}


def label(variant: Variant) -> str:
    """Return the name of a variant's loss for people."""
    return f"{variant.representation}, {'with' if variant.cross_check else 'without'} map"


def variant_table(found: dict[str, VariantFigures], variants: Sequence[Variant]) -> list[str]:
    """Return Table 1, or the study of alpha, as lines of Markdown: means and deviations over seeds."""
    rows = []
    for variant in variants:
        figures = found[variant.name]
        spread = {m: f" ± {figures.deviation[m]:.3f}" if figures.seeds > 1 else "" for m in MEASURES}
        cells = (f"{figures.mean[m]:.3f}{spread[m]}" for m in MEASURES)
        head = variant.name, label(variant), f"{variant.alpha:g}", figures.steps, figures.seeds
        rows.append((*head, *cells))
    return table(HEAD, rows)


def verdicts(found: dict[str, VariantFigures]) -> list[str]:
    """Return which of the six is best by every measure, and whether it is the paper's."""
    lines = []
    for measure, words in RANKED.items():
        best, second = sorted(SIX, key=lambda variant: found[variant.name].mean[measure])[:2]
        mean, spread = (getattr(found[best.name], of)[measure] for of in ("mean", "deviation"))
        next_ = found[second.name].mean[measure]
        lines.append(
            f"- Best of the six by {words}: {label(best)} (in the paper: {label(VARIANTS[BEST])}), "
            f"{mean:.3f}; next {label(second)}, {next_:.3f}: "
            f"{'within' if next_ - mean <= spread else 'beyond'} its deviation over seeds."
        )
    return lines


def read(results: Path, name: str) -> Any:
    """Return a stored result."""
    if not (path := results / name).exists():
        raise SystemExit(f"{path} is missing: the stages table1 and table2, and {EVALUATION}, make all")
    return json.loads(path.read_text())


def comparison(table2: Any, evaluation: Any) -> list[str]:
    """Return our figures under the published ones."""
    cells: list[tuple[str, ...]] = []
    for name, epe_s_px, inliers, true in PUBLISHED:
        shares = f"{inliers / 100:.3f}", f"{true / 100:.3f}", f"{inliers / true:.2f}"
        cells.append((f"{name}, as published", f"{epe_s_px:.3f}", "-", *shares))
    errors = (f"{evaluation['smears'][k]:.3f}" for k in ("epe_s_top50", "epe_s_top50_over_length"))
    rows = {(r["estimator"], r["beta"]): r for r in table2["rows"]}
    ours, true_F = rows["ours", paper_tables.AUTOMATIC], rows["true F", "-"]
    shares = f"{ours['inliers']:.3f}", f"{true_F['inliers']:.3f}", f"{ours['inliers_of_true']:.2f}"
    cells.append(("rendered test split, ours", *errors, *shares))
    head = "photographs | EPE-S top 50 %, px | over the length | SErrMin < 3, F | true F | fraction"
    note = "The paper's vector s is half of a smear; our EPE-S is of whole smears."
    return [*table(head, cells), "", note, f"Ours: `{EVALUATION}` and Table 2 below."]


def variants_of(document: Any) -> dict[str, VariantFigures]:
    """Return the stored figures of variants."""
    return {name: VariantFigures(**values) for name, values in document.items()}


def first_table(document: Any) -> list[str]:
    """Return Table 1."""
    found = variants_of(document)
    words = "Mean ± deviation over seeds, on 128 fixed crops of held-out textures."
    return [*variant_table(found, SIX), "", *verdicts(found), "", words]


def alpha_study(document: Any) -> list[str]:
    """Return the study of alpha."""
    lines = variant_table(variants_of(document), ALPHA_STUDY)
    return [*lines, "", "Over the seeds that all four have."]


def second_table(document: Any) -> list[str]:
    """Return Table 2 with its verdict."""
    rows = [paper_tables.Row(**row) for row in document["rows"]]
    words = [automatic_verdict(rows), "", f"Network {document['model_id']}."]
    return [*paper_tables.markdown(rows), "", *words]


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


PARTS = {
    "Table 1: losses": ("paper_table1.json", first_table, "table1", "6.5 core minutes a run"),
    "Table 2: shares of the smears and estimators": (
        "paper_table2.json", second_table, "table2", "11 core minutes",
    ),
    "Supplement: alpha": ("paper_alpha.json", alpha_study, "table1", "6.5 core minutes a run"),
}  # fmt: skip
"""Titles: the stored result, what writes it as text, the stage that makes it, its time."""


def report(results: Path) -> str:
    """Return the whole file."""
    beside = comparison(read(results, "paper_table2.json"), read(results, "evaluation.json"))
    sections = ["\n".join(["## Beside the published figures", "", *beside])]
    for title, (name, write, stage, budget) in PARTS.items():
        lines = [*write(read(results, name)), f"Made by `{COMMAND} {stage} report` ({budget})."]
        sections.append("\n".join([f"## {title}", "", *lines]))
    return "\n\n".join([INTRODUCTION, *sections]) + "\n"
