"""The paper's Table 2: how many of the surest smears to use, with the paper's estimator and with ours.

F is estimated from the Top-20, 35, 45 and 55 % of the smears (by sigma) of every photograph whose camera
translates, and judged on all true smears, movers among them, as the paper does: share with SErrMin < 3 and
median SErrMin, beside what the true F reaches. Every F is kept in a file at once, so a stopped run goes on.
"ours, automatic" takes, of the four answers for one photograph, the one that explains the Top-55 % best by
its robust cost (no truth is used).
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from blur2view.geometry.sampson import serrmin
from blur2view.smears.field import smear_ends
from blur2view.smears.grid import SmearGrid
from blur2view.smears.matches import SmearMatches
from blur2view.smears.selection import SelectOptions, select_matches
from blur2view.two_view.estimate import estimate_two_view
from tools.datasets.testset import TestScene
from tools.estimators.paper import paper_of_matches
from tools.evaluation import evaluate
from tools.pages import append_line, finished_lines, table

BETAS = (0.2, 0.35, 0.45, 0.55)
AUTOMATIC = "automatic"
ESTIMATORS: dict[str, Callable[[SmearMatches], AnyArray | None]] = {
    "paper": paper_of_matches,
    "ours": lambda matches: estimate_two_view(matches).F,
}
CUTOFF = 3.0  # standard deviations beyond which a smear counts as an outlier when answers are compared


@dataclass(frozen=True, kw_only=True)
class Found:
    """One estimate: F as nested lists or None, and the :func:`cost` of the smears of the largest share."""

    model_id: str
    scene: str
    estimator: str
    beta: float
    F: list[list[float]] | None
    cost: float
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Row:
    """One row of the table: mean inlier share, median of the images' medians and of seconds."""

    estimator: str
    beta: str
    images: int
    without_F: int
    inliers: float
    inliers_of_true: float
    serrmin_px2: float
    seconds: float


def cost(F: AnyArray | None, matches: SmearMatches) -> float:
    """Return the mean squared error of smears in sigmas, at most CUTOFF^2 each; that without F."""
    if F is None:
        return CUTOFF**2
    return float(np.minimum(serrmin(F, matches.ends) / matches.sampson_px**2, CUTOFF**2).mean())


def estimated(scene: TestScene, grid: SmearGrid, model_id: str, name: str, beta: float) -> Found:
    """Return one estimate of one photograph."""
    matches, began = select_matches(grid, SelectOptions(beta=beta)), time.perf_counter()
    F = ESTIMATORS[name](matches)
    seconds = time.perf_counter() - began
    return Found(
        model_id=model_id,
        scene=scene.name,
        estimator=name,
        beta=beta,
        F=None if F is None else F.tolist(),
        cost=cost(F, select_matches(grid, SelectOptions(beta=max(BETAS)))),
        seconds=seconds,
    )


def complete(scenes: Sequence[TestScene], network: blur2view.SmearNetwork, work: Path) -> list[Found]:
    """Return all estimates, making what is missing and keeping every answer at once."""
    model_id, wanted = network.info.model_id, [(name, beta) for name in ESTIMATORS for beta in BETAS]
    found = [one for line in finished_lines(work) if (one := Found(**line)).model_id == model_id]
    known = {(one.scene, one.estimator, one.beta) for one in found}
    work.parent.mkdir(parents=True, exist_ok=True)
    for scene in scenes:
        if left := [pair for pair in wanted if (scene.name, *pair) not in known]:
            grid = network.predict(blur2view.read_image(scene.image_path))
            for name, beta in left:
                found.append(estimated(scene, grid, model_id, name, beta))
                append_line(work, asdict(found[-1]))
    return found


def with_automatic(found: Sequence[Found]) -> dict[tuple[str, str], dict[str, Found]]:
    """Return answers by (estimator, beta) and scene, with our choice among our answers of every scene."""
    groups: dict[tuple[str, str], dict[str, Found]] = {}
    for one in found:
        groups.setdefault((one.estimator, f"{one.beta:.0%}"), {})[one.scene] = one
    mine = [group for (estimator, _), group in groups.items() if estimator == "ours"]
    groups["ours", AUTOMATIC] = {}
    for scene in sorted({scene for group in mine for scene in group}):
        answers = [group[scene] for group in mine if scene in group]
        seconds = sum(one.seconds for one in answers)  # all are needed for a choice
        groups["ours", AUTOMATIC][scene] = replace(min(answers, key=lambda one: one.cost), seconds=seconds)
    return groups


def all_true_ends(scene: TestScene) -> AnyArray:
    """Return the ends (N, 2, 2) of all valid true smears, movers' too."""
    return smear_ends(scene.midpoints[scene.valid], scene.displacement[scene.valid].astype(np.float64))


def judge(estimator: str, beta: str, group: dict[str, Found], scenes: Sequence[TestScene]) -> Row:
    """Return how good one way to estimate is on the scenes it was run on."""
    answers = [group[scene.name] for scene in scenes]
    judged, true = (
        [
            evaluate.judge(None if F is None else np.array(F), scene.F, scene.K, all_true_ends(scene))
            for F, scene in zip(matrices, scenes, strict=True)
        ]
        for matrices in ([one.F for one in answers], [scene.F for scene in scenes])
    )
    figures = evaluate.summarise(estimator, judged, true, sum(one.F is None for one in answers))
    shared = ("estimator", "beta", "seconds")
    return Row(
        estimator=estimator,
        beta=beta,
        seconds=float(np.median([one.seconds for one in answers])),
        **{f.name: getattr(figures, f.name) for f in fields(Row) if f.name not in shared},
    )


def rows_of(found: Sequence[Found], scenes: Sequence[TestScene]) -> list[Row]:
    """Return the table: every estimator and share on the scenes that all have, and the true F."""
    groups = with_automatic(found)
    shared = [scene for scene in scenes if all(scene.name in group for group in groups.values())]
    given = Found(model_id="", scene="", estimator="true F", beta=1.0, F=None, cost=0, seconds=0)
    true = {s.name: replace(given, scene=s.name, F=np.asarray(s.F).tolist()) for s in shared}
    keys = sorted(groups, key=lambda key: (key[0] == "ours", key[1]))
    return [*(judge(*key, groups[key], shared) for key in keys), judge("true F", "-", true, shared)]


def markdown(rows: Sequence[Row]) -> list[str]:
    """Return the table as lines of Markdown."""
    cells = [
        (r.estimator, r.beta, r.images, r.without_F, f"{r.inliers:.3f}", f"{r.inliers_of_true:.3f}")
        + (f"{r.serrmin_px2:.3g}", f"{r.seconds:.2f}")
        for r in rows
    ]
    head = "estimator | smears used | images | no F | SErrMin < 3 | of the true F's"
    return table(f"{head} | median SErrMin, px^2 | median s", cells)
