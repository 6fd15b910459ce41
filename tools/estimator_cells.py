"""The cells of the estimators' sweep: a base case, one factor changed at a time, both kinds of depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from blur2view.matches import select_matches
from blur2view.smear import SmearField
from tools.baselines import in_true_order
from tools.estimator_methods import Problem
from tools.evaluate import true_ends, truth_at_matches
from tools.synthetic_matches import Kind, SyntheticOptions, synthetic_smears
from tools.testset import TestScene, read_test_set

BASE = "base"
NETWORK = "network"
CELLS: dict[str, dict[str, Any]] = {
    BASE: {},
    **{f"outliers {share:.0%}": {"outliers": share} for share in (0.0, 0.15, 0.5, 0.6, 0.7)},
    **{f"second motion {s:.0%}": {"outliers": 0.0, "second_motion": s} for s in (0.15, 0.3, 0.45)},
    **{f"noise {px:g} px": {"noise_px": px} for px in (0.25, 0.5, 2.0)},
    **{f"noise {px:g} px, told as 1": {"noise_px": px, "report": "constant"} for px in (0.25, 0.5, 2.0)},
    **{f"noise {report}": {"report": report} for report in ("varied", "varied, constant", "varied, wrong")},
    **{f"length {px:g} px": {"length_px": px} for px in (5.0, 10.0, 40.0, 60.0)},
    **{m: {"motion": m} for m in ("forward", "sideways", "rotating", "near-planar")},
}
"""What every cell changes in the base case: 30 % random outliers, 1 px, 20 px smears, mixed motion."""
QUICK_CELLS = (BASE, "outliers 60%", "noise varied", "length 5 px", "forward")
SEEDS, QUICK_SEEDS = 40, 4
HARD, HARD_SEEDS = "outliers 60%", 100
"""The cell in which the issue asks for 100 seeds."""


@dataclass(frozen=True, kw_only=True, order=True)
class Instance:
    """One set of matches: of a synthetic cell and kind, or of a rendered photograph (kind NETWORK)."""

    seed: int
    cell: str
    kind: str

    @property
    def options(self) -> SyntheticOptions:
        """What the synthetic smears are like."""
        return SyntheticOptions(kind="smooth" if self.kind == "smooth" else "scattered", **CELLS[self.cell])

    @property
    def truthful(self) -> bool:
        """Whether the standard deviations that are told are the true ones; the network's are not known."""
        return self.kind != NETWORK and self.options.truthful


def instances(quick: bool = False) -> Iterator[Instance]:
    """Yield every instance of the sweep, seed by seed, so that a part of a run shows every cell."""
    for seed in range(QUICK_SEEDS if quick else HARD_SEEDS):
        for cell in QUICK_CELLS if quick else CELLS:
            if quick or seed < (HARD_SEEDS if cell == HARD else SEEDS):
                yield from (Instance(seed=seed, cell=cell, kind=kind) for kind in get_args(Kind))


def synthetic_problem(instance: Instance) -> Problem:
    """Draw the instance's smears."""
    s = synthetic_smears(instance.seed, instance.options)
    return Problem(matches=s.matches, ordered=s.ordered, true_ends=s.true_ends, K=s.K, R=s.R, t=s.t, F=s.F)


def network_problem(scene: TestScene, field: SmearField) -> Problem:
    """Give the matches that the network makes of a photograph, and their order by the true smears."""
    assert scene.F is not None
    matches = select_matches(field)
    return Problem(
        matches=matches,
        ordered=in_true_order(matches.ends, truth_at_matches(scene, matches)),
        true_ends=true_ends(scene),
        K=scene.K,
        R=scene.R,
        t=scene.t,
        F=scene.F,
    )


def moving_scenes(folder: Path) -> list[TestScene]:
    """Read the rendered scenes whose camera translates."""
    return [scene for scene in read_test_set(folder) if scene.F is not None]
