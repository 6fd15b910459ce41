"""The cells of the estimators' sweep: a base case, one factor changed at a time; what was measured."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, get_args

from blur2view.smears.grid import SmearGrid
from blur2view.smears.selection import select_matches
from tools.benchmarks.estimator_methods import PAPER, Problem
from tools.datasets.synthetic_matches import Kind, SyntheticOptions, synthetic_smears
from tools.datasets.testset import TestScene, read_test_set
from tools.estimators.baselines import in_true_order
from tools.evaluation.evaluate import Judged, true_ends, truth_at_matches

BASE = "base"
NETWORK = "network"
CELLS: dict[str, dict[str, Any]] = {
    BASE: {},
    **{f"outliers {share:.0%}": {"outliers": share} for share in (0.0, 0.15, 0.5, 0.6, 0.7)},
    **{f"second motion {s:.0%}": {"outliers": 0.0, "second_motion": s} for s in (0.15, 0.3, 0.45)},
    **{f"noise {px:g} px": {"noise_px": px} for px in (0.25, 0.5, 2.0)},
    **{f"noise {px:g} px, stated as 1": {"noise_px": px, "report": "constant"} for px in (0.25, 0.5, 2.0)},
    **{f"noise {report}": {"report": report} for report in ("varied", "varied, constant", "varied, wrong")},
    **{f"length {px:g} px": {"length_px": px} for px in (5.0, 10.0, 40.0, 60.0)},
    **{m: {"motion": m} for m in ("forward", "sideways", "rotating", "near-planar")},
}
"""What every cell changes in the base case: 30 % random outliers, 1 px, 20 px smears, mixed motion."""
HARD = "outliers 60%"  # the cell that gets more seeds: the hardest that most methods still solve
DEVELOPMENT_SEED = 10_000
"""First of the seeds that options may be tuned on (--first-seed); the tables are of seeds from 0."""


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
        """Whether the standard deviations that are stated are the true ones; the network's are not known."""
        return self.kind != NETWORK and self.options.truthful


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a run measures.

    ``seeds``, ``hard_seeds`` and ``paper_seeds`` are instances of every cell and kind, of HARD, and of those
    that the paper's estimator gets, which takes 6 to 7 s for one.
    """

    seeds: int = 40
    hard_seeds: int = 100
    paper_seeds: int = 3
    first_seed: int = 0

    def instances(self) -> Iterator[Instance]:
        """Yield the synthetic instances, seed by seed, so that a part of a run shows every cell."""
        for k in range(max(self.seeds, self.hard_seeds)):
            for cell in CELLS:
                if k < (self.hard_seeds if cell == HARD else self.seeds):
                    seed = self.first_seed + k
                    yield from (Instance(seed=seed, cell=cell, kind=kind) for kind in get_args(Kind))

    def photographs(self, scenes: int) -> list[Instance]:
        """Return the instances of network smears, if there are so many rendered scenes."""
        return [Instance(seed=k, cell=NETWORK, kind=NETWORK) for k in range(min(scenes, 2 * self.seeds))]

    def wants(self, method: str, instance: Instance) -> bool:
        """Whether a method runs on an instance: the paper's on the first few of a cell only."""
        first = 0 if instance.kind == NETWORK else self.first_seed
        return method != PAPER or instance.seed - first < self.paper_seeds


def synthetic_problem(instance: Instance) -> Problem:
    """Return the instance's smears."""
    s = synthetic_smears(instance.seed, instance.options)
    return Problem(matches=s.matches, ordered=s.ordered, true_ends=s.true_ends, K=s.K, R=s.R, t=s.t, F=s.F)


def network_problem(scene: TestScene, grid: SmearGrid) -> Problem:
    """Return the matches that the network makes of a photograph, and their order by the true smears."""
    assert scene.F is not None
    matches = select_matches(grid)
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
    """Return the rendered scenes whose camera translates."""
    return [scene for scene in read_test_set(folder) if scene.F is not None]


@dataclass(frozen=True, kw_only=True)
class Measured(Judged):
    """One method on one instance: `tools.evaluation.evaluate.Judged`, and the rest.

    ``pose_deg`` is `metrics.pose_error_deg`, ``ms`` the CPU time of the call.
    """

    pose_deg: float
    ms: float


@dataclass(frozen=True, kw_only=True)
class Record:
    """All methods on one instance."""

    instance: Instance
    measured: dict[str, Measured]

    def document(self) -> dict[str, Any]:
        """Return what is stored: figures to five digits."""
        rows = {
            method: {name: float(f"{value:.5g}") for name, value in vars(figures).items()}
            for method, figures in self.measured.items()
        }
        return {**vars(self.instance), "measured": rows}

    @classmethod
    def of(cls, stored: dict[str, Any]) -> Self:
        """Return the record of a `document`."""
        measured = {method: Measured(**row) for method, row in stored.pop("measured").items()}
        return cls(instance=Instance(**stored), measured=measured)
