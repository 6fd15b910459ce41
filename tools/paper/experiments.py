"""Run every experiment of the paper on rendered photographs and write tools/results/paper.md.

    python -m tools.paper.experiments --photos KODAK

renders what is missing (training scenes: 25 minutes of two cores), trains 27 networks (two hours), estimates
Table 2 (11 minutes of one core). Renderings and Table 2 go on where they were, trainings with the first seed
that is not finished; ``--stages report`` writes the file from what is there.
"""

import multiprocessing
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import blur2view
from tools.arguments import existing, parser_of
from tools.datasets.testset import read_test_set, test_options, write_test_set
from tools.pages import write_json
from tools.paper import paper_tables
from tools.paper.paper_report import read_runs, report
from tools.paper.paper_variants import ALPHA_STUDY, VARIANTS, TrainOptions, run_all
from tools.rendering.render import RenderOptions
from tools.training.recipe import Recipe, render_set

SCENES = 60
TRAINING_SCENES = 5150
SEEDS = (0, 1, 2)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Where things are.

    `shards` holds ``train`` and ``val``, as :func:`tools.training.recipe.render_all` renders them.
    """

    photos: Path | None
    work: Path
    shards: Path
    scenes: Path
    results: Path


def train(plan: Plan) -> None:
    """Render, train all variants, summarise Table 1."""
    train, val = plan.shards / "train", plan.shards / "val"
    held = range(Recipe.val_seed, Recipe.val_seed + Recipe.val_scenes)
    render_set(train, range(TRAINING_SCENES), RenderOptions(photos=plan.photos))
    render_set(val, held, RenderOptions(split="test", photos=plan.photos))
    options = TrainOptions(train=train, val=val, out=plan.work / "variants")
    run_all(list(VARIANTS.values()), SEEDS, options)
    summarise(plan)


def summarise(plan: Plan) -> None:
    """Store what is finished of Table 1."""
    runs = plan.work / "variants"
    found = read_runs(runs, VARIANTS.values())
    study = read_runs(runs, ALPHA_STUDY)
    if len(found) == len(VARIANTS):
        for name, figures in {"table1": found, "alpha": study}.items():
            write_json(plan.results / f"paper_{name}.json", {k: asdict(one) for k, one in figures.items()})


def estimate(plan: Plan) -> None:
    """Make Table 2."""
    write_test_set(plan.scenes, SCENES, test_options(plan.photos), multiprocessing.cpu_count())
    scenes, network = [s for s in read_test_set(plan.scenes) if s.F is not None], blur2view.SmearNetwork()
    rows = paper_tables.rows_of(paper_tables.complete(scenes, network, plan.work / "table2.jsonl"), scenes)
    document = {"model_id": network.info.model_id, "rows": [asdict(row) for row in rows]}
    write_json(plan.results / "paper_table2.json", document)


def write_report(plan: Plan) -> None:
    """Write paper.md from what is there."""
    summarise(plan)
    (plan.results / "paper.md").write_text(report(plan.results))


STAGES: dict[str, Callable[[Plan], None]] = {"table2": estimate, "table1": train, "report": write_report}


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--photos", type=existing, help="folder of the Kodak suite's 24 PNG files")
    parser.add_argument("--work", type=Path, default=Path("runs/paper"), help="(default: %(default)s)")
    parser.add_argument("--shards", type=existing, default=Path("render"), help="(default: %(default)s)")
    parser.add_argument("--scenes", type=existing, default=Path("render/test"), help="(default: %(default)s)")
    parser.add_argument("--results", type=Path, default=Path("tools/results"), help="(default: %(default)s)")
    parser.add_argument("--stages", nargs="+", choices=list(STAGES), default=list(STAGES))
    words = vars(parser.parse_args())
    stages = words.pop("stages")
    for name in stages:
        STAGES[name](Plan(**words))


if __name__ == "__main__":
    main()
