"""Table 1 and the study of alpha: what the runs of `paper_variants` reached, over their seeds."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tools.pages import table
from tools.paper.paper_variants import SIX, VARIANTS, Variant

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
