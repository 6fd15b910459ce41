"""The text of tools/results/paper.md: the experiments on rendered photographs, beside what was published."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from tools.pages import Record, record_table, table
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
EVALUATION = "python -m tools.evaluation.evaluate render/test --out tools/results/evaluation"

TEXT = """# The paper's experiments, on our data

The paper: *Robust Fundamental Matrix Estimation from Single Image Motion Blur* (Tran, Forssén, Viksten,
arXiv 2605.01552). None of its datasets is in this repository, so **its figures and ours are of different
photographs**: ours are rendered (`tools/datasets/testset.py`, `tools/datasets/shards.py`). What can be
compared are fractions of what the true F reaches, and which variant is best.

`python -m tools.paper.experiments --photos KODAK` makes all of this file: about three hours of two cores, two
of them for the 27 trainings of Table 1 and of the study of alpha; finished seeds are kept.

## Beside the published figures

{beside}

The paper's vector s is half of a smear; our EPE-S is of whole smears.
Ours: `{evaluation}` and Table 2 below.

Who has the paper's data sets fills the rows "as published" with figures of the network that ships:

| row | `python -m tools.` |
|---|---|
| Monkaa | `paper.datasets monkaa ROOT --out monkaa`, `evaluation.evaluate monkaa` |
| Driving | `paper.datasets driving ROOT --out driving`, `evaluation.evaluate driving` |
| GoPro | `paper.datasets gopro ROOT --out gopro`, `evaluation.evaluate gopro` |
| RBI | `paper.datasets rbi ROOT --out rbi`, `evaluation.evaluate rbi` |

`evaluate` prints EPE-S of the certain half, its size over the length, and the inliers of F and of the true F.

## Table 1: losses

{losses}

{verdicts}

Mean ± deviation over seeds, on 128 fixed crops of held-out textures.
Made by `python -m tools.paper.experiments --photos KODAK --stages table1 report` (6.5 core minutes a run).

## Table 2: shares of the smears and estimators

{shares}

{automatic}

Network {model_id}.
Made by `python -m tools.paper.experiments --photos KODAK --stages table2 report` (11 core minutes).

## Supplement: alpha

{alpha}

Over the seeds that all four have.
Made by `python -m tools.paper.experiments --photos KODAK --stages table1 report` (6.5 core minutes a run).
"""


def read(path: Path) -> Record:
    """Return a stored result."""
    if not path.exists():
        raise SystemExit(f"{path} is missing: the stages table1 and table2, and {EVALUATION}, make all")
    document: Record = json.loads(path.read_text())
    return document


def report(results: Path) -> str:
    """Return the whole file, of the results in a folder."""
    table1, alpha, table2 = (read(results / f"paper_{name}.json") for name in ("table1", "alpha", "table2"))
    parts = {
        "beside": table(BESIDE_HEAD, comparison(table2, read(results / "evaluation.json")["smears"])),
        "losses": variant_table(table1, SIX),
        "verdicts": verdicts(table1),
        "shares": record_table(SHARES_HEAD, SHARES_ROW, table2["rows"]),
        "alpha": variant_table(alpha, ALPHA_STUDY),
    }
    texts = {name: "\n".join(lines) for name, lines in parts.items()}
    words = {"automatic": automatic_verdict(table2["rows"]), "model_id": table2["model_id"]}
    return TEXT.format(**texts, **words, evaluation=EVALUATION)


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
