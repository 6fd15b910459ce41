"""Measure smears and F on the rendered test split.

    python -m tools.datasets.testset render/test --scenes 60 --photos KODAK
    python -m tools.evaluation.evaluate render/test --out tools/results/evaluation.md

prints the tables and writes the page. Every method gets the same matches, the network's own. F is judged on
the true smears of static pixels.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import blur2view
from blur2view import SmearGrid, SmearMatches, select_matches
from blur2view.arrays import AnyArray
from blur2view.geometry.sampson import serrmin
from tools.arguments import Existing, Target, run
from tools.datasets.synthetic_matches import KnownMatches
from tools.datasets.testset import TestScene, read_test_set
from tools.estimators.baselines import METHODS, OURS, against
from tools.evaluation.smear_figures import evaluate_smears, pooled, smear_tables
from tools.metrics import PAPER_INLIER, epipole_angle_deg, rho, share_under
from tools.pages import Record, joined, publish, record_table

SHARES = ("under_05", "under_10", "inliers")  # what of `Judged` is a share of the smears; the rest are errors
HEAD = (
    "F from | images | none | median rho | rho < 0.05 | rho < 0.10 | SErrMin < 3 | of the true F's "
    "| median SErrMin, px^2 | epipole, deg"
)
ROW = (
    "{method} | {images} | {without_F} | {rho:.4f} | {under_05:.3f} | {under_10:.3f} | {inliers:.3f} "
    "| {inliers_of_true:.3f} | {serrmin_px2:.3g} | {epipole_deg:.1f}"
)


NAMES = (
    OURS, "two-parameter F", "unordered, OpenCV MAGSAC", "u > 0 order, OpenCV MAGSAC",
    "true order, OpenCV MAGSAC", "true order, pycolmap", "true order, PoseLib",
)  # fmt: skip


def known_matches(scene: TestScene, matches: SmearMatches) -> KnownMatches:
    """Return matches read in a photograph, with what is true of it; their order is by true smears."""
    swapped = against(matches.ends, scene.truth_at(matches))
    return KnownMatches(
        K=scene.K, R=scene.R, t=scene.t, matches=matches, true_ends=scene.true_ends, swapped=swapped,
        outlier=np.zeros_like(swapped),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One F on one image's true smears; the epipole's angle is that of rays, up to the flip of time.

    Medians over smears of ``rho`` and ``serrmin_px2``; the shares of smears with a rho below 0.05 and 0.10,
    and of the paper's inliers.
    """

    rho: float
    under_05: float
    under_10: float
    inliers: float
    serrmin_px2: float
    epipole_deg: float


def judge(F: AnyArray | None, F_true: AnyArray | None, K: AnyArray, ends: AnyArray) -> Judged:
    """Return how good F is on true ends (N, 2, 2), beside the true F and for the true K.

    None is the worst answer: errors as long as the smears, and an epipole at right angles.
    """
    if F is None or F_true is None:
        squared = float(np.median(((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1)))
        return Judged(rho=1.0, under_05=0.0, under_10=0.0, inliers=0.0, serrmin_px2=squared, epipole_deg=90.0)
    relative, squared_px = rho(F, ends), serrmin(F, ends)
    return Judged(
        rho=float(np.median(relative)),
        under_05=share_under(relative, 0.05),
        under_10=share_under(relative, 0.10),
        inliers=share_under(squared_px, PAPER_INLIER),
        serrmin_px2=float(np.median(squared_px)),
        epipole_deg=epipole_angle_deg(F, F_true, K),
    )


def summarise(method: str, judged: list[Judged], reference: list[Judged], missing: int) -> Record:
    """Return medians of the errors, means of the shares, and inliers as a fraction of the true F's."""
    values = {name: [one[name] for one in map(asdict, judged)] for name in asdict(judged[0])}
    found = {name: float((np.mean if name in SHARES else np.median)(some)) for name, some in values.items()}
    found["inliers_of_true"] = found["inliers"] / float(np.mean([r.inliers for r in reference]))
    return {"method": method, "images": len(judged), "without_F": missing} | found


def evaluate_fundamentals(scenes: Iterable[tuple[TestScene, SmearGrid]]) -> list[Record]:
    """Return figures of every method over the images whose camera translates; no F counts as the worst."""
    table: dict[str, list[Judged]] = {}
    missing: dict[str, int] = {}
    for scene, grid in scenes:
        if scene.F is None:
            continue
        known = known_matches(scene, select_matches(grid))
        found = {name: METHODS[name](known) for name in NAMES} | {"true F": scene.F}
        for name, F in found.items():
            table.setdefault(name, []).append(judge(F, scene.F, scene.K, known.true_ends))
            missing[name] = missing.get(name, 0) + (F is None)
    return [summarise(name, rows, table["true F"], missing[name]) for name, rows in table.items()]


def main(scenes: Path, *, model: Existing | None = None, out: Target | None = None) -> None:
    """Evaluate a network, the shipped one by default, on a test set, and write the page."""
    network = blur2view.SmearNetwork(model)
    pairs = [(scene, network.predict(scene.image)) for scene in read_test_set(scenes)]
    figures = evaluate_smears(*pooled((scene, grid.at_pixels()) for scene, grid in pairs))
    fundamentals = evaluate_fundamentals(pairs)
    words = f"Model {network.model_id}, {figures.images} images."
    text = joined(words, smear_tables(figures), record_table(HEAD, ROW, fundamentals))
    publish(text, out)


if __name__ == "__main__":
    run(main)
