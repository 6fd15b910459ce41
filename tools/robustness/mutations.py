"""Change one place of the core modules at a time, and see whether a test notices.

    python -m tools.robustness.mutations --count 120 --seed 0

Every mutant is one small change, drawn from one seed: a comparison or a sign turned, an operator exchanged,
a number enlarged, a condition negated, a statement left out. The tests that reach its function in the fast
path, found by one recorded run, are run on a copy of the checkout, shortest first; a mutant that none of them
notices survives. Which survivors change nothing that can be seen is for a reader to say.
"""

from __future__ import annotations

import argparse
import json
import os
import re
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

from tools.robustness.mutation_sites import Mutant, mutants_of

ROOT = Path(__file__).resolve().parents[2]
CORE = (
    "camera", "smears", "geometry", "networks", "robust", "two_view", "exposure", "colmap",
    "output_files.py", "input_files.py", "pipeline.py",
)  # fmt: skip
COPIED = ("blur2view", "tools", "tests", "models", "pyproject.toml", "README.md", ".ci", "CITATION.cff")
FAST = "not slow and not train and not browser and not lint"
PYTEST = ("-q", "-x", "-p", "no:cacheprovider", "-m", FAST)
LIMIT_S = 60.0  # of the tests of one mutant beyond three times what they take
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
            places = (f"{mutant.path}:{mutant.function}",)
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
    """Return what becomes of a mutant."""
    tests = reached.tests_of(mutant)
    if not tests:
        return UNREACHED
    limit_s = LIMIT_S + 3 * sum(reached.seconds[test] for test in tests)
    copy = copies.get()
    path = copy / mutant.path
    original = path.read_text()
    path.write_text(mutant.source)
    try:
        words = [sys.executable, "-m", "pytest", *PYTEST, f"@{_arguments(copy, tests)}"]
        child = subprocess.Popen(
            words,
            cwd=copy,
            env=environment_of(copy),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            return SURVIVED if child.wait(limit_s) == 0 else KILLED
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            child.wait()
            return TIMEOUT
    finally:
        path.write_text(original)
        copies.put(copy)


def _arguments(copy: Path, tests: Sequence[str]) -> Path:
    """Return a file that names the tests, of which there may be more than a command line takes."""
    path = copy / "tests.txt"
    path.write_text("\n".join(tests))
    return path


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
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1, help="mutants tested at a time")
    parser.add_argument("--reached", type=Path, help="file that keeps which test calls what, if there is one")
    parser.add_argument("--only", default="", help="mutants whose path and line, PATH:LINE, start so")
    parser.add_argument("--out", type=Path, help="write the table there, too")
    options = parser.parse_args()
    every = [one for one in core_mutants() if f"{one.path}:{one.line}".startswith(options.only)]
    chosen = np.random.default_rng(options.seed).permutation(len(every))[: options.count]
    drawn = sorted((every[index] for index in chosen), key=lambda mutant: (mutant.path, mutant.line))
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        copies: Queue[Path] = Queue()
        for job in range(options.jobs):
            copies.put(copy_checkout(Path(name) / str(job)))
        if options.reached and options.reached.exists():
            reached = Reached(**json.loads(options.reached.read_text()))
        else:
            reached = record(Path(name) / "0")
            if options.reached:
                shutil.copy(Path(name) / "0" / "reached.json", options.reached)
        print(f"{len(reached.seconds)} tests recorded in {time.perf_counter() - start:.0f} s", flush=True)
        outcomes = []
        with ThreadPoolExecutor(options.jobs) as pool:
            for mutant, outcome in zip(
                drawn, pool.map(partial(judge, reached=reached, copies=copies), drawn), strict=True
            ):
                outcomes.append(outcome)
                print(f"{outcome}: {mutant.path}:{mutant.line} {mutant.change}", flush=True)
    table = report(drawn, outcomes, len(every), options.seed)
    print(table)
    if options.out:
        options.out.write_text(table)


if __name__ == "__main__":
    main()
