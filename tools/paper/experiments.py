"""Run every experiment of the paper on rendered photographs and write tools/results/paper.md.

    python -m tools.paper.experiments --photos KODAK

renders what is missing (training scenes: 25 minutes of two cores), trains 27 networks (two hours), estimates
Table 2 (11 minutes of one core). Every finished seed of Table 1 and every estimate of Table 2 is a line of
``table1.jsonl`` or ``table2.jsonl``, so a stopped run goes on; ``--stages report`` writes the file from what
is there.

Table 2 asks how many of the surest smears to use, with the paper's estimator and with ours. F is estimated
from the Top-20, 35, 45 and 55 % of the smears (by sigma) of every photograph whose camera translates, and
judged on all true smears, movers among them, as the paper does: share with SErrMin < 3 and median SErrMin,
beside what the true F reaches. "ours, automatic" takes, of the four answers for one photograph, the one that
explains the Top-55 % best by its robust cost (no truth is used).
"""

import multiprocessing
import time
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

import blur2view
from blur2view.arrays import AnyArray
from blur2view.geometry.sampson import serrmin
from blur2view.smears.field import smear_ends
from blur2view.smears.grid import SmearGrid
from blur2view.smears.matches import SmearMatches
from blur2view.smears.selection import SelectOptions, select_matches
from blur2view.two_view.estimate import estimate_two_view
from tools.arguments import Existing, run
from tools.datasets.shards import load_shards, write_scenes
from tools.datasets.testset import TestScene, read_test_set, test_options, write_test_set
from tools.estimators.paper import paper_of_matches
from tools.evaluation.evaluate import judge, summarise
from tools.pages import Record, finished_lines, sweep, write_json
from tools.paper.paper_report import AUTOMATIC, TABLES, report
from tools.paper.paper_variants import MEASURES, VARIANTS, TrainOptions, Variant, run_seed, validation_crops
from tools.rendering.render import RenderOptions
from tools.training.recipe import HELD_SCENES, HELD_SEED

SCENES, TRAINING_SCENES = 60, 5150
SEEDS = (0, 1, 2)
BETAS = (0.2, 0.35, 0.45, 0.55)
ESTIMATORS: dict[str, Callable[[SmearMatches], AnyArray | None]] = {
    "paper": paper_of_matches,
    "ours": lambda matches: estimate_two_view(matches).F,
}
CUTOFF = 3.0  # standard deviations beyond which a smear counts as an outlier when answers are compared
ROW = ("images", "without_F", "inliers", "inliers_of_true", "serrmin_px2")


def train(photos: Path | None, shards: Path, log: Path, options: TrainOptions | None = None) -> None:
    """Render, and train all variants with every seed."""
    options, jobs, held = (
        options or TrainOptions(),
        multiprocessing.cpu_count(),
        range(HELD_SEED, HELD_SEED + HELD_SCENES),
    )
    write_scenes(shards / "train", range(TRAINING_SCENES), RenderOptions(photos=photos), jobs)
    of_test = RenderOptions(split="test", photos=photos)
    write_scenes(shards / "val", held, of_test, jobs)
    cv2.setNumThreads(1)  # ends OpenCV's pool: workers are forked, and would wait for threads they lack
    scenes, crops = load_shards(shards / "train"), validation_crops(shards / "val")
    budget = {"steps": options.steps, "batch": options.batch, "side": options.side}
    head = budget | {"scenes": len(scenes["labels"]), "variants": [variant.name for variant in VARIANTS]}
    sweep(
        log,
        head,
        [{"seed": seed} for seed in SEEDS],
        lambda key: {**key, "runs": run_seed(key["seed"], scenes, crops, options)},
    )


def averaged(variants: Iterable[Variant], records: Sequence[Record], steps: int) -> Record:
    """Return the means and deviations of variants over seeds, by name."""
    document = {}
    for name in (variant.name for variant in variants):
        values = {measure: [record["runs"][name][measure] for record in records] for measure in MEASURES}
        mean, deviation = ({m: float(of(v)) for m, v in values.items()} for of in (np.mean, np.std))
        document[name] = {
            "name": name, "seeds": len(records), "steps": steps, "mean": mean, "deviation": deviation,
        }  # fmt: skip
    return document


def estimates(scenes: Sequence[TestScene], network: blur2view.SmearNetwork, log: Path) -> list[Record]:
    """Return all estimates, making what is missing."""
    named = {scene.name: scene for scene in scenes}

    @lru_cache(maxsize=1)
    def grid_of(name: str) -> SmearGrid:
        return network.predict(blur2view.read_image(named[name].image_path))

    def work(key: Record) -> Record:
        grid = grid_of(key["scene"])
        matches, start = select_matches(grid, SelectOptions(beta=key["beta"])), time.perf_counter()
        F = ESTIMATORS[key["estimator"]](matches)
        seconds = time.perf_counter() - start
        score = cost(F, select_matches(grid, SelectOptions(beta=max(BETAS))))
        return {**key, "F": None if F is None else F.tolist(), "cost": score, "seconds": seconds}

    keys = [{"scene": s, "estimator": name, "beta": b} for s in named for name in ESTIMATORS for b in BETAS]
    return sweep(log, {"model_id": network.info.model_id}, keys, work)


def cost(F: AnyArray | None, matches: SmearMatches) -> float:
    """Return the mean squared error of smears in sigmas, at most CUTOFF^2 each; that without F."""
    if F is None:
        return CUTOFF**2
    return float(np.minimum(serrmin(F, matches.ends) / matches.sampson_px**2, CUTOFF**2).mean())


def all_true_ends(scene: TestScene) -> AnyArray:
    """Return the ends (N, 2, 2) of all valid true smears, movers' too."""
    return smear_ends(scene.midpoints[scene.valid], scene.displacement[scene.valid].astype(np.float64))


def rows_of(records: Iterable[Record], scenes: Sequence[TestScene]) -> list[Record]:
    """Return the rows of Table 2: every estimator and share, our choice among ours, and the true F."""
    groups: dict[tuple[str, str], dict[str, Record]] = {}
    for record in records:
        groups.setdefault((record["estimator"], f"{record['beta']:.0%}"), {})[record["scene"]] = record
    ours, groups["ours", AUTOMATIC] = [groups["ours", f"{beta:.0%}"] for beta in BETAS], {}
    for name in (scene.name for scene in scenes):
        answers = [group[name] for group in ours]  # all are needed for a choice
        chosen = {"seconds": sum(one["seconds"] for one in answers)}
        groups["ours", AUTOMATIC][name] = min(answers, key=lambda one: one["cost"]) | chosen
    groups["true F", "-"] = {scene.name: {"F": scene.F, "seconds": 0.0} for scene in scenes}
    return [row(*key, [group[scene.name] for scene in scenes], scenes) for key, group in groups.items()]


def row(estimator: str, beta: str, answers: Sequence[Record], scenes: Sequence[TestScene]) -> Record:
    """Return how good one way to estimate is: mean share of inliers, medians of medians and of seconds."""
    matrices = [None if one["F"] is None else np.array(one["F"]) for one in answers]
    judged, true = (
        [judge(F, s.F, s.K, all_true_ends(s)) for F, s in zip(found, scenes, strict=True)]
        for found in (matrices, [s.F for s in scenes])
    )
    figures = summarise(estimator, judged, true, sum(F is None for F in matrices))
    seconds = float(np.median([one["seconds"] for one in answers]))
    return {"estimator": estimator, "beta": beta} | {k: figures[k] for k in ROW} | {"seconds": seconds}


Stage = Literal["table2", "table1", "report"]


def main(
    *,
    photos: Existing | None = None,
    work: Path = Path("runs/paper"),
    shards: Path = Path("render"),
    scenes: Path = Path("render/test"),
    results: Path = Path("tools/results"),
    stages: Sequence[Stage] = ("table2", "table1", "report"),
) -> None:
    """Run stages, with the Kodak suite's 24 PNG files in a folder.

    ``shards`` holds ``train`` and ``val``, ``scenes`` the test set.
    """
    if "table2" in stages:
        write_test_set(scenes, SCENES, test_options(photos), multiprocessing.cpu_count())
        moving, network = [s for s in read_test_set(scenes) if s.F is not None], blur2view.SmearNetwork()
        rows = rows_of(estimates(moving, network, work / "table2.jsonl"), moving)
        write_json(results / "paper_table2.json", {"model_id": network.info.model_id, "rows": rows})
    if "table1" in stages:
        train(photos, shards, work / "table1.jsonl")
    if "report" in stages:
        head, *records = finished_lines(work / "table1.jsonl") or [{}]
        for name, variants in TABLES.items() if records else ():
            write_json(results / f"paper_{name}.json", averaged(variants, records, head["steps"]))
        (results / "paper.md").write_text(report(results))


if __name__ == "__main__":
    run(main)
