"""Give every command hostile photographs, arguments, networks and disks, and see whether it stays polite.

    python -m tools.robustness.hostile_inputs --count 1000 --seed 0 --log done.jsonl

Each input is drawn from one seed. Photographs come in batches, with a good one among them, through every
command; a list, stream, video, argument, network or full disk comes alone with the good one; so does a
database, through the commands that read or link to one, a model, through those that read it, and what an
earlier call left and somebody changed, through those that go on with it. Each call is a process of its own: a
fork of this one, which has libraries and network loaded, with --jobs 1; or, for one in 100, a fresh
interpreter that starts as many processes as it likes.

A call is polite if it ends by itself within 20 seconds of processor time and 2 GiB with exit code 0, 1 or 2;
prints nothing but its own lines, one for each failure; leaves nothing but whole results; does all that it
does not refuse; runs nothing that a file says; and changes no byte of a database that it refuses, no row of
the user's in any. It also has to end within 180 seconds of any time: who waits for ever takes no processor.

With --log every finished case is written down. A second call with the same count and seed passes over those
that were polite and tries the rude ones again; if they are polite now, the table counts them as mended.
Ctrl-C ends a call with the table of what is done by then.
"""

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
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from tools.arguments import parser_of, target
from tools.pages import append_line, begun, publish, table
from tools.robustness.hostile_cases import COMMANDS, GOOD, OTHER, RESUMED, Case, make_cases
from tools.robustness.hostile_databases import SIZE, changes, snapshot
from tools.robustness.hostile_files import blurred
from tools.robustness.hostile_models import OF_MODELS
from tools.robustness.hostile_results import RAN, earlier
from tools.robustness.politeness import MOST_GIB, MOST_S, Call, complaints

PATIENCE_S = 180.0  # of any time; a call shares the machine with others
FRESH_EVERY = 100


def run_call(words: Sequence[str], folder: Path, case: Case, *, fresh: bool) -> Call:
    """Return what a call did, in a process of its own."""
    start = time.perf_counter()
    child = os.fork()
    if child == 0:
        _child(words, folder, case, fresh)
    code = None
    while not (ended := os.wait4(child, os.WNOHANG))[0] and time.perf_counter() - start < PATIENCE_S:
        time.sleep(0.01)
    with contextlib.suppress(ProcessLookupError):  # and the processes that it started
        os.killpg(child, signal.SIGKILL)
    if ended[0]:
        code = os.waitstatus_to_exitcode(ended[1])
    else:
        ended = os.wait4(child, 0)
    usage = ended[2]
    return Call(
        words=list(words),
        folder=folder,
        photographs=[folder / GOOD, *case.photographs],
        counted=not case.named,
        code=code,
        printed=(folder / ".stdout").read_bytes(),
        said=(folder / ".stderr").read_bytes(),
        seconds=usage.ru_utime + usage.ru_stime,
        peak_gib=usage.ru_maxrss / 2**20,
    )


def _child(words: Sequence[str], folder: Path, case: Case, fresh: bool) -> None:
    """Become the program, with its streams in files."""
    code = 99
    try:
        os.setsid()
        os.chdir(folder)
        os.environ["HOME"] = str(folder / ".home")
        for stream, name in ((1, ".stdout"), (2, ".stderr")):
            os.dup2(os.open(name, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600), stream)
        os.dup2(os.open(case.stdin, os.O_RDONLY), 0)
        resource.setrlimit(resource.RLIMIT_CPU, (int(MOST_S) + 1, int(MOST_S) + 2))
        if case.largest_file is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (case.largest_file, case.largest_file))
        if fresh:
            os.environ["PYTHONPATH"] = str(Path(__file__).parents[2])
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


@dataclass(frozen=True, kw_only=True)
class Tried:
    """What came of one case, through all commands.

    ``rude`` are its complaints, ``mended`` those of earlier tries; ``codes`` are exit codes, None of a call
    that had to be ended.
    """

    number: int
    kind: str
    inputs: int
    codes: list[int | None]
    longest_s: float
    most_gib: float
    rude: list[str]
    mended: int = 0


def try_all(
    count: int, seed: int, say: Callable[[str], object] = print, log: Path | None = None
) -> list[Tried]:
    """Return what came of the cases of ``count`` hostile inputs."""
    head = {"count": count, "seed": seed}
    tried = {} if log is None else {line["number"]: Tried(**line) for line in begun(log, head)}
    _load_libraries()
    with tempfile.TemporaryDirectory() as name, contextlib.suppress(KeyboardInterrupt):
        place, inputs = Path(name), Path(name) / "inputs"
        inputs.mkdir()
        cases = make_cases(inputs, count, seed)
        for number, photograph in enumerate((GOOD, OTHER)):
            blurred(np.random.default_rng(seed + number), SIZE).save(inputs / photograph, "JPEG", quality=95)
        if any(case.commands is RESUMED for case in cases):
            _call_earlier(place)
        left = [number for number in range(len(cases)) if number not in tried or tried[number].rude]
        for done, number in enumerate(left, len(cases) - len(left) + 1):
            one = _through_all_commands(place, number, cases[number])
            if before := tried.get(number):
                mended = before.mended + (0 if one.rude else len(before.rude))
                one = replace(one, mended=mended)
            tried[number] = one
            if log is not None:
                append_line(log, asdict(one))
            for complaint in one.rude:
                say(f"RUDE {one.kind} {number}: {complaint}")
            if done % 20 == 0:
                say(f"{done} of {len(cases)} cases, {sum(len(each.rude) for each in tried.values())} rude")
    return [tried[number] for number in sorted(tried)]


def _through_all_commands(place: Path, number: int, case: Case) -> Tried:
    """Return what came of every command's call with one case."""
    calls, rude = [], []
    for index, words in enumerate(case.commands):
        folder = place / f"{number}-{index}"
        folder.mkdir()
        shutil.copy(place / "inputs" / GOOD, folder)
        if case.prepare is not None:
            case.prepare(folder, words)
        kept = snapshot(folder) if case.kind == "databases" else None
        named = case.named or ["--", *map(str, case.photographs)]
        first = named.index("--") + 1
        # no shell can pass a null character
        fresh = (number * len(COMMANDS) + index) % FRESH_EVERY == 0
        fresh = fresh and "\0" not in "".join([*case.words, *named])
        alone = [] if fresh else ["--jobs", "1"]
        more = [*alone, *case.words, *named[:first], GOOD, *named[first:]]
        call = run_call([*words, *([] if case.commands is OF_MODELS else more)], folder, case, fresh=fresh)
        found = complaints(call, full_disk=case.largest_file is not None, prepared=case.prepare is not None)
        found += [] if kept is None else changes(call, kept)
        found += [f"runs what a result says, see {RAN}"] if (folder / RAN).exists() else []
        rude += [f"{complaint}: {call.words!r}" for complaint in found]
        calls.append(call)
        _remove(folder)
    return Tried(
        number=number,
        kind=case.kind,
        inputs=len(case.photographs) or 1,
        codes=[call.code for call in calls],
        longest_s=max(call.seconds for call in calls),
        most_gib=max(call.peak_gib for call in calls),
        rude=rude,
    )


def _call_earlier(place: Path) -> None:
    """Call every command that can go on, with two good photographs."""
    for words in RESUMED:
        folder = earlier(place, words)
        folder.mkdir()
        for name in (GOOD, OTHER):
            shutil.copy(place / "inputs" / name, folder)
        call = run_call([*words, "--jobs", "1", GOOD, OTHER], folder, Case(kind=""), fresh=False)
        if call.code != 0:
            raise SystemExit(f"{words}: fails with good photographs: {call.said.decode()}")


def _remove(folder: Path) -> None:
    for path in folder.rglob("*"):
        if path.is_dir() and not path.is_symlink():
            path.chmod(stat.S_IRWXU)
    shutil.rmtree(folder)


def _load_libraries() -> None:
    """Import what the commands need and load the shipped network, of one thread, so that forks need not."""
    for module in (
        "blur2view.cli.estimate", "blur2view.cli.segment", "blur2view.cli.report", "blur2view.cli.to_colmap",
        "blur2view.cli.place", "blur2view.cli.to_transforms", "blur2view.cli.triage", "pycolmap",
        "scipy.ndimage", "scipy.optimize",
    ):  # fmt: skip
        importlib.import_module(module)
    from blur2view.cli.work import CommandNetwork, _loaded
    from blur2view.photographs import video

    video._reader.cache_clear()  # a video that is open here has threads that forks do not have
    _loaded.cache_clear()
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})  # so that the network has no threads, either
    CommandNetwork.of(None)  # 0.2 of the 0.3 s that a call takes
    os.sched_setaffinity(0, cores)
    gc.freeze()


def page(tries: Sequence[Tried], count: int, seed: int) -> str:
    """Return what came of the cases as Markdown."""
    done, rows = sum(tried.inputs for tried in tries), []
    for kind in [*sorted({tried.kind for tried in tries}), "all"]:
        some = [tried for tried in tries if kind in (tried.kind, "all")]
        codes = Counter(code for tried in some for code in tried.codes)
        longest, most = (max(getattr(tried, name) for tried in some) for name in ("longest_s", "most_gib"))
        rows.append((
            kind, sum(tried.inputs for tried in some), codes.total(), f"{codes[0]}, {codes[1]}, {codes[2]}",
            f"{longest:.1f}", f"{most:.2f}", sum(tried.mended for tried in some),
            sum(len(tried.rude) for tried in some),
        ))  # fmt: skip
    head = "hostile | inputs | calls | exit codes 0, 1, 2 | longest, s of a processor | most memory, GiB"
    return "\n".join([
        f"Seed {seed}, {done} of {count} inputs. Rude is a call with a traceback, a foreign line, a line too",
        "many or too few, a partial or strange file, a good photograph left undone, or one that takes more",
        f"than {MOST_GIB:.0f} GiB, {MOST_S:.0f} s of processor time or {PATIENCE_S:.0f} s of any. Mended are "
        "complaints of inputs that were",
        "polite when tried again.", "",
        *table(f"{head} | mended | rude", rows), "",
    ])  # fmt: skip


def main() -> None:
    """Print every rude call and the table; exit with 1 if there is one."""
    parser = parser_of(__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=target, help="write every finished case there, and go on from it")
    parser.add_argument("--out", type=target, help="write the table there, too")
    options = parser.parse_args()
    tries = try_all(options.count, options.seed, partial(print, flush=True), options.log)
    publish(page(tries, options.count, options.seed), options.out)
    raise SystemExit(any(tried.rude for tried in tries))


if __name__ == "__main__":
    main()
