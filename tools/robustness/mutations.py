"""Change one place of the core modules at a time, and see whether a test notices.

    python -m tools.robustness.mutations --count 120 --seed 0

Every mutant is one small change, drawn from one seed: a comparison or a sign turned, an operator exchanged,
a number enlarged, a condition negated, a statement left out. The tests that reach its function in the fast
path, found by one recorded run, are run on a copy of the checkout, shortest first; a mutant that none of them
notices survives. Which survivors change nothing that can be seen is for a reader to say.
"""

from __future__ import annotations

import argparse
import gc
import importlib
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
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

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
    "scipy.sparse.csgraph",
    "scipy.spatial", "scipy.linalg", "skimage.segmentation", "skimage.filters",
)  # fmt: skip
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


def judge(mutant: Mutant, reached: Reached, copy: Path) -> str:
    """Return what becomes of a mutant in a copy of the checkout, which is as before afterwards."""
    tests = reached.tests_of(mutant)
    if not tests:
        return UNREACHED
    limit_s = LIMIT_S + 3 * sum(reached.seconds[test] for test in tests)
    path = copy / mutant.path
    original = path.read_text()
    path.write_text(mutant.source)
    try:
        return _tested(copy, tests, limit_s)
    finally:
        path.write_text(original)


def _tested(copy: Path, tests: Sequence[str], limit_s: float) -> str:
    """Return the outcome of the tests, in a fork of this process, which has the libraries loaded."""
    child = os.fork()
    if child == 0:
        try:
            os.setsid()
            os.chdir(copy)
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
    while time.perf_counter() - start < limit_s:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return SURVIVED if os.waitstatus_to_exitcode(status) == 0 else KILLED
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
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reached", type=Path, help="file that keeps which test calls what, if there is one")
    parser.add_argument("--only", default="", help="mutants whose path and line, PATH:LINE, start so")
    parser.add_argument("--out", type=Path, help="write the table there, too")
    options = parser.parse_args()
    every = [one for one in core_mutants() if f"{one.path}:{one.line}".startswith(options.only)]
    chosen = np.random.default_rng(options.seed).permutation(len(every))[: options.count]
    drawn = sorted((every[index] for index in chosen), key=lambda mutant: (mutant.path, mutant.line))
    start = time.perf_counter()
    outcomes = []
    with tempfile.TemporaryDirectory() as name:
        copy = copy_checkout(Path(name))
        if options.reached and options.reached.exists():
            reached = Reached(**json.loads(options.reached.read_text()))
        else:
            reached = record(copy)
            if options.reached:
                shutil.copy(copy / "reached.json", options.reached)
        print(f"{len(reached.seconds)} tests recorded in {time.perf_counter() - start:.0f} s", flush=True)
        load_libraries()
        for mutant in drawn:
            outcomes.append(judge(mutant, reached, copy))
            print(f"{outcomes[-1]}: {mutant.path}:{mutant.line} {mutant.change}", flush=True)
    table = report(drawn, outcomes, len(every), options.seed)
    print(table)
    if options.out:
        options.out.write_text(table)


if __name__ == "__main__":
    main()
