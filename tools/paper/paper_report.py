"""The tables of tools/results/paper.md: experiments on rendered photographs, beside what was published."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from tools.pages import Record, filled, record_table, table
from tools.paper.paper_variants import ALPHA_STUDY, MEASURES, SIX, Variant

AUTOMATIC = "automatic"
TABLES: dict[str, Sequence[Variant]] = {"table1": SIX, "alpha": ALPHA_STUDY}
RANKED = {
    "epe_s_top50": "EPE-S top 50 %",
    "sparsification_area": "sparsification area",
    "epe_s_left": "EPE-S left (mean over all shares removed by sigma)",
}
BEST = Variant()  # the one that the paper found best
VARIANT_HEAD = (
    "name | loss | alpha | steps | seeds | EPE-S top 50 %, px | over the length | sparsification area "
    "| EPE-S left, px | oracle, px | direction top 50 %, deg"
)
VARIANT_ROW = "{name} | {loss} | {alpha:g} | {steps} | {seeds}"
SHARES_HEAD = (
    "estimator | smears used | images | no F | SErrMin < 3 | of the true F's | median SErrMin, px^2 "
    "| median s"
)
SHARES_ROW = (
    "{estimator} | {beta} | {images} | {without_F} | {inliers:.3f} | {inliers_of_true:.3f} "
    "| {serrmin_px2:.3g} | {seconds:.2f}"
)
BESIDE_HEAD = "photographs | EPE-S top 50 %, px | over the length | SErrMin < 3, F | true F | fraction"
PUBLISHED = (
    ("Monkaa", 0.829, 42.25, 60.45),
    ("Driving", 10.405, 32.35, 70.28),
    ("GoPro", 0.996, 30.21, 58.10),
    ("RBI", 2.389, 34.62, 59.39),
)
"""What the paper reports of a dataset: EPE-S of the top 50 %, px; inliers of its F and of the true F, %."""
PAGE = Path(__file__).resolve().parents[1] / "results/paper.md"


def read(path: Path) -> Record:
    """Return a stored result."""
    if not path.exists():
        raise SystemExit(
            f"{path} is missing: stages table1 and table2, and tools.evaluation.evaluate, make all"
        )
    document: Record = json.loads(path.read_text())
    return document


def report(results: Path) -> str:
    """Return the page with the tables of the results in a folder."""
    table1, alpha, table2 = (read(results / f"paper_{name}.json") for name in ("table1", "alpha", "table2"))
    shares, network = record_table(SHARES_HEAD, SHARES_ROW, table2["rows"]), table2["model_id"]
    beside = comparison(table2, read(results / "evaluation.json")["smears"])
    parts = {
        "beside": table(BESIDE_HEAD, beside),
        "losses": [*variant_table(table1, SIX), "", *verdicts(table1)],
        "shares": [*shares, "", automatic_verdict(table2["rows"]), "", f"Network {network}."],
        "alpha": variant_table(alpha, ALPHA_STUDY),
    }
    return filled(PAGE.read_text(), parts)


def comparison(table2: Record, smears: Record) -> Iterator[tuple[str, ...]]:
    """Yield the published figures, then ours."""
    for name, epe_s_px, inliers, true in PUBLISHED:
        shares = f"{inliers / 100:.3f}", f"{true / 100:.3f}", f"{inliers / true:.2f}"
        yield f"{name}, as published", f"{epe_s_px:.3f}", "-", *shares
    errors = (f"{smears[name]:.3f}" for name in ("epe_s_top50", "epe_s_top50_over_length"))
    rows = {(row["estimator"], row["beta"]): row for row in table2["rows"]}
    ours, true_F = rows["ours", AUTOMATIC], rows["true F", "-"]
    shares = f"{ours['inliers']:.3f}", f"{true_F['inliers']:.3f}", f"{ours['inliers_of_true']:.2f}"
    yield "rendered test split, ours", *errors, *shares


def variant_table(found: Record, variants: Sequence[Variant]) -> list[str]:
    """Return Table 1, or the study of alpha, as lines of Markdown: means and deviations over seeds."""
    records = [found[v.name] | {"loss": v.loss, "alpha": v.alpha} for v in variants]
    cell = "{{mean[{0}]:.3f}}"
    if any(record["seeds"] > 1 for record in records):
        cell += " ± {{deviation[{0}]:.3f}}"
    return record_table(VARIANT_HEAD, " | ".join([VARIANT_ROW, *map(cell.format, MEASURES)]), records)


def verdicts(found: Record) -> Iterator[str]:
    """Yield which of the six is best by every measure, and whether it is the paper's."""
    for measure, words in RANKED.items():
        best, second = sorted(SIX, key=lambda variant: found[variant.name]["mean"][measure])[:2]
        mean, spread = (found[best.name][of][measure] for of in ("mean", "deviation"))
        after = found[second.name]["mean"][measure]
        yield (
            f"- Best of the six by {words}: {best.loss} (in the paper: {BEST.loss}), {mean:.3f}; next "
            f"{second.loss}, {after:.3f}: {'within' if after - mean <= spread else 'beyond'} its deviation "
            "over seeds."
        )


def automatic_verdict(rows: Sequence[Record]) -> str:
    """Return whether choosing automatically is as good as the best fixed share."""
    ours = {row["beta"]: row for row in rows if row["estimator"] == "ours"}
    chosen = ours.pop(AUTOMATIC)
    share, median = max(r["inliers"] for r in ours.values()), min(r["serrmin_px2"] for r in ours.values())
    words = [
        "at least as good as" if good else "worse than"
        for good in (chosen["inliers"] >= share, chosen["serrmin_px2"] <= median)
    ]
    return (
        f"Choosing automatically is {words[0]} the best fixed share by inliers ({chosen['inliers']:.3f}, "
        f"{share:.3f}) and {words[1]} it by the median ({chosen['serrmin_px2']:.3g}, {median:.3g} px^2)."
    )
