"""Give every command hostile photographs, arguments, networks and disks, and see whether it stays polite.

    python -m tools.robustness.hostile_inputs --count 1000 --seed 0

Each input is drawn from one seed. Photographs come in batches, with a good one among them, through every
command; a list, video, argument, network or full disk comes alone with the good one. Each call is a process
of its own: a fork of this one, which has the libraries loaded, or a fresh interpreter for one in twenty.

A call is polite if it ends by itself within 30 seconds and 2 GiB with exit code 0, 1 or 2; prints nothing but
its own lines, one for each failure; leaves nothing but whole results; and does all that it does not refuse.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import importlib
import os
import resource
import shutil
import signal
import stat
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from tools.arguments import target
from tools.robustness.hostile_arguments import hostile_arguments
from tools.robustness.hostile_files import blurred, hostile_model, hostile_photograph
from tools.robustness.hostile_lists import hostile_list, hostile_video
from tools.robustness.politeness import Call, complaints

LIMIT_S, LIMIT_GIB = 30.0, 2.0
BATCH, FRESH_EVERY = 8, 20
COMMANDS = (
    ("estimate", "-o", "out"),
    ("estimate", "--json"),
    ("segment", "-o", "out"),
    ("report", "-o", "page.html"),
    ("to-colmap", "--db", "new.db"),
    ("to-colmap", "--format", "matches", "-o", "out"),
    ("to-colmap", "--format", "hloc", "-o", "out"),
    ("triage", "--csv", "table.csv", "--keep", "keep.txt"),
    ("to-transforms", "-o", "transforms.json"),
)
GOOD = "good.jpg"


@dataclass(frozen=True, kw_only=True)
class Case:
    """What is hostile in one call: options, photographs beside the good one, a limit on file sizes.

    ``named`` are words for photographs, of which nobody knows how many they are.
    """

    kind: str
    words: list[str] = field(default_factory=list)
    photographs: list[Path] = field(default_factory=list)
    named: list[str] = field(default_factory=list)
    largest_file: int | None = None


def make_cases(folder: Path, count: int, seed: int) -> list[Case]:
    """Return cases of ``count`` hostile inputs, half of them photographs."""
    shares = {
        "photographs": round(0.5 * count),
        "lists": round(0.08 * count),
        "videos": round(0.06 * count),
        "networks": round(0.1 * count),
        "disks": round(0.05 * count),
    }
    cases: list[Case] = []
    made: list[Path] = []
    for number in range(shares["photographs"]):
        rng = np.random.default_rng([seed, 0, number])
        made.append(hostile_photograph(folder, rng, number)[1])
        if len(made) == BATCH or number == shares["photographs"] - 1:
            cases.append(Case(kind="photographs", photographs=made))
            made = []
    hostile = [path for case in cases for path in case.photographs]
    for number in range(shares["lists"]):
        rng = np.random.default_rng([seed, 4, number])
        cases.append(Case(kind="lists", named=["--", *hostile_list(folder, rng, number, hostile)]))
    for number in range(shares["videos"]):
        rng = np.random.default_rng([seed, 5, number])
        cases.append(Case(kind="videos", named=hostile_video(folder, rng, number)))
    for number in range(shares["networks"]):
        kind, path = hostile_model(folder, np.random.default_rng([seed, 1, number]), number)
        cases.append(Case(kind="networks", words=["--model", str(path)]))
    for number in range(shares["disks"]):
        rng = np.random.default_rng([seed, 2, number])
        cases.append(Case(kind="full disks", largest_file=int(10 ** rng.uniform(3.6, 5.7))))
    for number in range(count - sum(shares.values())):
        words = hostile_arguments(np.random.default_rng([seed, 3, number]))
        cases.append(Case(kind="arguments", words=words))
    return cases


def run_call(words: Sequence[str], folder: Path, case: Case, *, fresh: bool) -> Call:
    """Return what a call did, in a process of its own."""
    start = time.perf_counter()
    child = os.fork()
    if child == 0:
        _child(words, folder, case, fresh)
    code, usage, waited_s = None, None, 0.0
    while time.perf_counter() - start - (waited_s := _waited_s(child, waited_s)) < LIMIT_S:
        pid, status, usage = os.wait4(child, os.WNOHANG)
        if pid:
            code = os.waitstatus_to_exitcode(status)
            break
        time.sleep(0.01)
    else:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        _, _, usage = os.wait4(child, 0)
    return Call(
        words=list(words),
        folder=folder,
        photographs=[folder / GOOD, *case.photographs],
        counted=not case.named,
        code=code,
        printed=(folder / ".stdout").read_bytes(),
        said=(folder / ".stderr").read_bytes(),
        seconds=time.perf_counter() - start - waited_s,
        peak_gib=usage.ru_maxrss / 2**20 if usage else 0.0,
    )


def _waited_s(child: int, before_s: float) -> float:
    """Return how long a process waited for a processor, which others had; as before where it has ended."""
    try:
        return int(Path(f"/proc/{child}/schedstat").read_text().split()[1]) / 1e9
    except (OSError, IndexError):
        return before_s


def _child(words: Sequence[str], folder: Path, case: Case, fresh: bool) -> None:
    """Become the program, with its streams in files."""
    code = 99
    try:
        os.setsid()
        os.chdir(folder)
        os.environ["HOME"] = str(folder / ".home")
        for stream, name in ((1, ".stdout"), (2, ".stderr")):
            os.dup2(os.open(name, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600), stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        if case.largest_file is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (case.largest_file, case.largest_file))
        if fresh:
            os.execv(sys.executable, [sys.executable, "-m", "blur2view", *words])
        from blur2view.__main__ import program

        sys.argv = ["blur2view", *words]
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        try:
            code = program()
        except SystemExit as error:
            code = error.code if isinstance(error.code, int) else 1
        sys.stdout.flush()
    except BaseException:
        os.write(1, traceback.format_exc().encode("utf-8", "replace"))
    finally:
        os._exit(code)


@dataclass(kw_only=True)
class Tally:
    """What came of the calls of one kind of input."""

    inputs: int = 0
    calls: int = 0
    codes: Counter[object] = field(default_factory=Counter)
    rude: list[str] = field(default_factory=list)
    longest_s: float = 0.0
    most_gib: float = 0.0


def try_all(count: int, seed: int, say: Callable[[str], object] = print, jobs: int = 1) -> dict[str, Tally]:
    """Return what came of ``count`` hostile inputs, by kind."""
    tallies: dict[str, Tally] = {}
    _load_libraries()
    with tempfile.TemporaryDirectory() as name:
        inputs = Path(name) / "inputs"
        inputs.mkdir()
        cases = make_cases(inputs, count, seed)
        blurred(np.random.default_rng(seed), (120, 90)).save(inputs / GOOD, "JPEG", quality=95)
        with ThreadPoolExecutor(jobs) as pool:
            called = pool.map(partial(_through_all_commands, Path(name)), range(len(cases)), cases)
            for number, (case, results) in enumerate(zip(cases, called, strict=True)):
                tally = tallies.setdefault(case.kind, Tally())
                tally.inputs += len(case.photographs) or 1
                for call, rude in results:
                    tally.calls += 1
                    tally.codes[call.code] += 1
                    tally.longest_s = max(tally.longest_s, call.seconds)
                    tally.most_gib = max(tally.most_gib, call.peak_gib)
                    tally.rude += rude
                    for complaint in rude:
                        say(f"RUDE {case.kind} {number}: {complaint}: {call.words!r}")
                if number % 20 == 19:
                    rude_calls = sum(len(tally.rude) for tally in tallies.values())
                    say(f"{number + 1} of {len(cases)} cases, {rude_calls} rude")
    return tallies


def _through_all_commands(place: Path, number: int, case: Case) -> list[tuple[Call, list[str]]]:
    """Return every command's call with one case, and what is wrong with it."""
    results = []
    for index, words in enumerate(COMMANDS):
        folder = place / f"{number}-{index}"
        folder.mkdir()
        shutil.copy(place / "inputs" / GOOD, folder)
        named = case.named or ["--", *map(str, case.photographs)]
        first = named.index("--") + 1
        every = [*words, *case.words, *named[:first], GOOD, *named[first:]]
        # no shell can pass a null character
        fresh = fresh_call(number, index) and "\0" not in "".join(every)
        call = run_call(every, folder, case, fresh=fresh)
        results.append((call, complaints(call, full_disk=case.largest_file is not None)))
        _remove(folder)
    return results


def fresh_call(number: int, index: int) -> bool:
    """Return whether a call gets a fresh interpreter."""
    return (number * len(COMMANDS) + index) % FRESH_EVERY == 0


def _remove(folder: Path) -> None:
    """Remove a folder, whatever modes its files have."""
    for path in folder.rglob("*"):
        if path.is_dir() and not path.is_symlink():
            path.chmod(stat.S_IRWXU)
    shutil.rmtree(folder)


def _load_libraries() -> None:
    """Import what the commands need, so that forks need not."""
    for module in (
        "blur2view.cli.estimate", "blur2view.cli.segment", "blur2view.cli.report", "blur2view.cli.to_colmap",
        "blur2view.cli.to_transforms", "blur2view.cli.triage", "pycolmap", "scipy.ndimage", "h5py",
        "scipy.optimize",
    ):  # fmt: skip
        importlib.import_module(module)
    from blur2view.networks.model_file import _onnxruntime

    _onnxruntime()
    gc.freeze()


def table(tallies: dict[str, Tally], seed: int) -> str:
    """Return what came of the inputs as Markdown."""
    lines = [
        f"Seed {seed}. Rude is a call with a traceback, a foreign line, a line too many or too few, a",
        "partial or strange file, a hang over 30 s, more than 2 GiB, or a good photograph left undone.",
        "",
        "| hostile | inputs | calls | exit codes 0, 1, 2 | longest, s | most memory, GiB | rude |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind, tally in tallies.items():
        codes = ", ".join(str(tally.codes[code]) for code in (0, 1, 2))
        lines.append(
            f"| {kind} | {tally.inputs} | {tally.calls} | {codes} | {tally.longest_s:.1f} | "
            f"{tally.most_gib:.2f} | {len(tally.rude)} |"
        )
    total = [sum(getattr(tally, name) for tally in tallies.values()) for name in ("inputs", "calls")]
    rude = sum(len(tally.rude) for tally in tallies.values())
    return "\n".join([*lines, f"| all | {total[0]} | {total[1]} | | | | **{rude}** |"]) + "\n"


def main() -> None:
    """Print every rude call and the table; exit with 1 if there is one."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1, help="calls at a time")
    parser.add_argument("--out", type=target, help="write the table there, too")
    options = parser.parse_args()
    tallies = try_all(options.count, options.seed, partial(print, flush=True), options.jobs)
    found = table(tallies, options.seed)
    print(found)
    if options.out:
        options.out.write_text(found)
    raise SystemExit(any(tally.rude for tally in tallies.values()))


if __name__ == "__main__":
    main()
