"""Change one place of the core modules at a time, and see whether a test notices.

    python -m tools.robustness.mutations --count 120 --seed 0

Every mutant is one small change, drawn from one seed: a comparison or a sign turned, an operator exchanged,
a number enlarged, a condition negated, a statement left out. The tests that reach its function in the fast
path, found by one recorded run, are run on a copy of the checkout, shortest first; a mutant that none of them
notices survives. Which survivors change nothing that can be seen is for a reader to say.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from queue import Queue

import numpy as np
import pytest

from tools.arguments import parser_of, target
from tools.robustness.mutation_sites import Mutant, mutants_of

ROOT = Path(__file__).resolve().parents[2]
CORE = (
    "camera", "smears", "geometry", "networks", "robust", "two_view", "exposure", "colmap",
    "output_files.py", "input_files.py", "pipeline.py",
)  # fmt: skip
COPIED = ("blur2view", "tools", "tests", "models", "pyproject.toml", "README.md", ".ci", "CITATION.cff")
FAST = "not slow and not train and not browser and not lint"
PYTEST = ("-q", "-x", "-p", "no:cacheprovider", "-m", FAST)
LIBRARIES = (
    "cv2", "onnx.helper", "onnxruntime", "PIL.Image", "pycolmap", "scipy.ndimage", "scipy.optimize",
    "scipy.spatial", "scipy.linalg",
)  # fmt: skip
LIMIT_S, MOST_S = 30.0, 1800.0  # of a mutant's tests: processor time beyond thrice theirs; by the clock
KILLED, SURVIVED, TIMEOUT, UNREACHED = "killed", "survived", "killed by its time", "reached by no test"


@dataclass(frozen=True, kw_only=True)
class Reached:
    """Which functions, "path:qualified name", each test calls, and how many seconds it takes."""

    functions: dict[str, list[str]]
    seconds: dict[str, float]

    def tests_of(self, mutant: Mutant) -> list[str]:
        """Return the tests that reach a mutant's function, shortest first.

        Of a value outside functions those that reach a module in which its name occurs.
        """
        if "()" in mutant.function:
            places: tuple[str, ...] = (f"{mutant.path}:{mutant.function}",)
        else:
            places = tuple(f"{path}:" for path in {mutant.path} | naming(mutant.function or "?"))
        tests = [
            test for test, called in self.functions.items() if any(name.startswith(places) for name in called)
        ]
        return sorted(tests, key=lambda test: self.seconds[test])


@lru_cache
def naming(name: str) -> set[str]:
    """Return the modules of the package in which a name occurs."""
    word = re.compile(rf"\b{re.escape(name)}\b")
    paths = (ROOT / "blur2view").rglob("*.py")
    return {path.relative_to(ROOT).as_posix() for path in paths if word.search(path.read_text())}


def record(copy: Path) -> Reached:
    """Run the fast path once and note what each test calls."""
    target = copy / "reached.json"
    environment = environment_of(copy) | {"BLUR2VIEW_REACHED": str(target)}
    words = [sys.executable, "-m", "pytest", *PYTEST, "-p", "tools.robustness.reached"]
    done = subprocess.run(words, cwd=copy, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"the tests fail without any mutation:\n{done.stdout[-3000:]}")
    return Reached(**json.loads(target.read_text()))


def reached_by(kept: Path | None, copy: Path) -> Reached:
    """Return what each test calls: from a file that an earlier run kept, or by a run of the tests."""
    if kept is not None and kept.exists():
        return Reached(**json.loads(kept.read_text()))
    reached = record(copy)
    if kept is not None:
        shutil.copy(copy / "reached.json", kept)
    return reached


def environment_of(copy: Path) -> dict[str, str]:
    """Return the environment in which tests see the copy alone."""
    return os.environ | {"PYTHONPATH": str(copy), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}


def copy_checkout(folder: Path) -> Path:
    """Return a copy of what the tests need."""
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        elif source.exists():
            shutil.copy(source, folder / name)
    return folder


def judge(mutant: Mutant, reached: Reached, copies: Queue[Path]) -> str:
    """Return what becomes of a mutant in one of the copies of the checkout."""
    tests = reached.tests_of(mutant)
    if not tests:
        return UNREACHED
    copy = copies.get()
    limit_s = LIMIT_S + 3 * sum(reached.seconds[test] for test in tests)
    path = copy / mutant.path
    original = path.read_text()
    path.write_text(mutant.source)
    try:
        return _tested(copy, tests, limit_s)
    finally:
        path.write_text(original)
        copies.put(copy)


def _tested(copy: Path, tests: Sequence[str], limit_s: float) -> str:
    """Return the outcome of the tests, in a fork of this process, which has the libraries loaded."""
    child = os.fork()
    if child == 0:
        try:
            os.setsid()
            os.chdir(copy)
            resource.setrlimit(resource.RLIMIT_CPU, (round(limit_s), round(limit_s)))
            os.environ.update(environment_of(copy))
            for stream in (1, 2):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
            sys.path[:] = [str(copy), *(entry for entry in sys.path if Path(entry).resolve() != ROOT)]
            for name in [name for name in sys.modules if name.partition(".")[0] == "tools"]:
                del sys.modules[name]
            os._exit(int(pytest.main([*PYTEST, *tests])))
        finally:
            os._exit(1)
    start = time.perf_counter()
    while time.perf_counter() - start < MOST_S:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            code = os.waitstatus_to_exitcode(status)
            return (
                SURVIVED if code == 0 else TIMEOUT if code in (-signal.SIGXCPU, -signal.SIGKILL) else KILLED
            )
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return TIMEOUT


def load_libraries() -> None:
    """Import what tests need of others, so that forks need not."""
    for name in LIBRARIES:
        importlib.import_module(name)
    gc.freeze()


def core_mutants() -> Iterator[Mutant]:
    """Yield every mutant of the core modules."""
    for name in CORE:
        place = ROOT / "blur2view" / name
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            yield from mutants_of(path.relative_to(ROOT).as_posix(), path.read_text())


def report(drawn: Sequence[Mutant], outcomes: Sequence[str], total: int, seed: int) -> str:
    """Return the table of outcomes, and of survivors, as Markdown."""
    lines = [f"{len(drawn)} of {total} mutants, seed {seed}.", "", "| outcome | count |", "|---|---|"]
    lines += [f"| {kind} | {outcomes.count(kind)} |" for kind in (KILLED, TIMEOUT, SURVIVED, UNREACHED)]
    lines += ["", "| place | change | outcome |", "|---|---|---|"]
    for mutant, outcome in zip(drawn, outcomes, strict=True):
        if outcome in (SURVIVED, UNREACHED):
            change = mutant.change.replace("|", "\\|")
            lines.append(f"| `{mutant.path}:{mutant.line}` {mutant.function} | {change} | {outcome} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print a line for each mutant that survives, and the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--count", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1, help="mutants tested at a time")
    parser.add_argument("--reached", type=Path, help="file that keeps which test calls what, if there is one")
    parser.add_argument("--only", default="", help="mutants whose path and line, PATH:LINE, start so")
    parser.add_argument("--out", type=target, help="write the table there, too")
    options = parser.parse_args()
    every = [one for one in core_mutants() if f"{one.path}:{one.line}".startswith(options.only)]
    chosen = np.random.default_rng(options.seed).permutation(len(every))[: options.count]
    drawn = sorted((every[index] for index in chosen), key=lambda mutant: (mutant.path, mutant.line))
    start = time.perf_counter()
    outcomes = []
    with tempfile.TemporaryDirectory() as name:
        copies: Queue[Path] = Queue()
        for job in range(options.jobs):
            copies.put(copy_checkout(Path(name) / str(job)))
        reached = reached_by(options.reached, Path(name) / "0")
        print(f"{len(reached.seconds)} tests recorded in {time.perf_counter() - start:.0f} s", flush=True)
        load_libraries()
        with ThreadPoolExecutor(options.jobs) as pool:
            judged = pool.map(partial(judge, reached=reached, copies=copies), drawn)
            for mutant, outcome in zip(drawn, judged, strict=True):
                outcomes.append(outcome)
                print(f"{outcome}: {mutant.path}:{mutant.line} {mutant.change}", flush=True)
    table = report(drawn, outcomes, len(every), options.seed)
    print(table)
    if options.out:
        options.out.write_text(table)


if __name__ == "__main__":
    main()
