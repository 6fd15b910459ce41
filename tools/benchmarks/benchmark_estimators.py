"""Compare estimators of F, ours and those that are given the order, on synthetic and on network smears.

    python -m tools.datasets.testset render/test --scenes 60 --photos KODAK
    python -m tools.benchmarks.benchmark_estimators --scenes render/test

sweeps one factor at a time (`estimator_cells`), appends one JSON line per finished instance to
``runs/estimators.jsonl`` and writes ``tools/results/estimators.md``. A run that was stopped goes on where it
was; ``--first-seed 10000`` takes other seeds, to tune on. Every method gets the same matches in the same
process, one after the other, with one thread; times are CPU times of single calls.
"""

import hashlib
import time
from dataclasses import asdict, replace
from functools import cache, partial
from importlib import metadata
from pathlib import Path
from typing import Any

import blur2view
from tools.arguments import existing, parser_of, target
from tools.benchmarks import estimator_report
from tools.benchmarks.estimator_cells import (
    BASE,
    DEVELOPMENT_SEED,
    NETWORK,
    Instance,
    Measured,
    Plan,
    Record,
    moving_scenes,
    network_problem,
    synthetic_problem,
)
from tools.benchmarks.estimator_methods import METHODS, PAPER, Method, Problem
from tools.evaluation.benchmark import machine
from tools.evaluation.evaluate import judge
from tools.metrics import NO_POSE_DEG, pose_error_deg
from tools.pages import append_line, begun, finished_lines, publish
from tools.processes import single_threaded_pool

ROOT = Path(__file__).resolve().parents[2]


def measure(method: Method, problem: Problem) -> Measured:
    """Return how good a method's F of a problem is, and its CPU time."""
    start = time.process_time()
    F = method(problem)
    seconds = time.process_time() - start
    judged = judge(F, problem.F, problem.K, problem.true_ends)
    ends = problem.matches.ends
    pose = NO_POSE_DEG if F is None else pose_error_deg(F, problem.K, problem.R, problem.t, ends)
    return Measured(**asdict(judged), pose_deg=pose, ms=1e3 * seconds)


def run_instance(instance: Instance, plan: Plan, scenes: Path | None = None) -> Record:
    """Return the figures of every method that the plan wants; ``scenes`` holds the photographs of NETWORK."""
    warm_up()
    if instance.kind == NETWORK:
        assert scenes is not None
        scene = _scenes(scenes)[instance.seed]
        problem = network_problem(scene, _network().predict(blur2view.read_image(scene.image_path)))
    else:
        problem = synthetic_problem(instance)
    wanted = {name: method for name, method in METHODS.items() if plan.wants(name, instance)}
    return Record(instance=instance, measured={name: measure(one, problem) for name, one in wanted.items()})


@cache
def _scenes(folder: Path) -> list[Any]:
    return moving_scenes(folder)


@cache
def _network() -> blur2view.SmearNetwork:
    return blur2view.SmearNetwork()


@cache
def warm_up() -> None:
    """Let every library load and allocate before it is timed."""
    problem = synthetic_problem(Instance(seed=DEVELOPMENT_SEED, cell=BASE, kind="smooth"))
    for name, method in METHODS.items():
        if name != PAPER:
            measure(method, problem)


def head() -> dict[str, str]:
    """Return what figures may depend on: a digest of all sources, the machine, versions of libraries."""
    sources = sorted(path for room in ("blur2view", "tools") for path in (ROOT / room).rglob("*.py"))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:12]
    libraries = ("numpy", "opencv-contrib-python-headless", "pycolmap", "poselib")
    return {"code": digest, "machine": machine(), **{name: metadata.version(name) for name in libraries}}


def sweep(pending: list[Instance], log: Path, plan: Plan, processes: int, scenes: Path | None) -> None:
    """Run instances in parallel and log each when it is finished."""
    with single_threaded_pool(processes) as pool:
        work = partial(run_instance, plan=plan, scenes=scenes)
        start = time.perf_counter()
        for count, record in enumerate(pool.imap_unordered(work, pending), 1):
            append_line(log, record.document())
            if count % 100 == 0:
                left = (time.perf_counter() - start) / count * (len(pending) - count) / 60
                print(f"{count} of {len(pending)} instances, {left:.0f} min left", flush=True)


def run(log: Path, plan: Plan, processes: int, scenes: Path | None) -> None:
    """Run what the log does not hold yet."""
    done = {Record.of(row).instance for row in begun(log, head())}
    wanted = [*plan.instances(), *plan.photographs(len(_scenes(scenes)) if scenes else 0)]
    pending = [instance for instance in wanted if instance not in done]
    if pending:
        sweep(pending, log, plan, processes, scenes)


def main() -> None:
    """Command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, help="instances of every cell and kind (default: 40, some 100)")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--paper-seeds", type=int, default=Plan.paper_seeds, help="for the paper's: slow")
    parser.add_argument("--report", action="store_true", help="run nothing, write the tables of the log")
    parser.add_argument(
        "--scenes", type=existing, help="folder of tools.datasets.testset, for network smears"
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--log", type=Path, default=Path("runs/estimators.jsonl"))
    parser.add_argument("--out", type=target, default=Path("tools/results/estimators.md"))
    arguments = parser.parse_args()
    plan = Plan(first_seed=arguments.first_seed, paper_seeds=arguments.paper_seeds)
    if arguments.seeds:
        plan = replace(plan, seeds=arguments.seeds, hard_seeds=arguments.seeds)
    if not arguments.report:
        run(arguments.log, plan, arguments.processes, arguments.scenes)
    first, *rows = finished_lines(arguments.log) or [{}]
    publish(estimator_report.markdown([Record.of(row) for row in rows], first), arguments.out)


if __name__ == "__main__":
    main()
