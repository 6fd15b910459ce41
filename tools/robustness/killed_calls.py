"""Kill calls at random moments, let two run at once, and go on with --resume: nothing of the user's is lost.

    python -m tools.robustness.killed_calls --kills 30 --seed 0

A call is killed with SIGKILL after a random number of changes to its folder, so that short writes are hit as
often as long work; alone, or with its worker processes. Then every file of a result must be whole, a project
as it was or wholly linked, a backup a copy of it, the photographs untouched; and the same call with --resume
must end with exit code 0 and leave what a call leaves that nobody disturbs. The same is asked of two equal
calls at once, of which one may refuse in one line.
"""

import os
import shutil
import signal
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from subprocess import Popen

import numpy as np

from tools.arguments import Target, run
from tools.pages import joined, publish, table
from tools.robustness.corpus import make_project, start
from tools.robustness.mutations import Rng
from tools.robustness.politeness import flaw, rows, snapshot

CALLS = (
    "estimate --no-timings -o out",
    "segment --no-timings -o out",
    "triage --no-timings --csv table.csv --keep keep.txt",
    "to-colmap --db new.db",
    "to-colmap --db project.db --link",
    "to-colmap --db project.db --link --no-backup --replace",
)
LOGS = "-wal", "-shm", "-journal"
NOT_COMPARED = (".manifest.jsonl", "-wal", "-shm", ".bak")  # order of lines; logs that rows() reads; names
State = dict[str, object]


def ended(call: Popen[bytes]) -> str:
    """Return what a call that failed said, when its workers are gone, too; nothing of one that did not."""
    said = call.communicate()[1].decode(errors="replace")
    return said or f"exit code {call.returncode}" if call.returncode else ""


def left(folder: Path) -> State:
    """Return what a folder holds: bytes of files, rows of databases."""
    files = {name: data for name, data in snapshot(folder).items() if not name.endswith(NOT_COMPARED)}
    return files | {name: rows(folder / name) for name in files if name.endswith(".db")}


def lost(folder: Path, before: State, after: State) -> list[str]:
    """Return what of the user's is changed, and which results are not whole.

    ``before`` and ``after`` are what was left by nothing and by a call that nobody disturbs.
    """
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    whole = [path for path in files if not path.name.startswith(".") and not path.name.endswith(LOGS)]
    found = [f"{path.name} {why}" for path in whole if (why := flaw(path))]
    backups = [path for path in whole if path.suffix == ".bak"]
    found += [f"{path.name} is no copy" for path in backups if rows(path) != before["project.db"]]
    now = left(folder)
    return found + [f"{name} is lost" for name in before if now.get(name) not in (before[name], after[name])]


def changes(call: Popen[bytes], folder: Path, most: float) -> int:
    """Wait until a folder has changed so many times or the call has ended; return how often it changed."""
    seen, count = None, -1
    while count < most and call.poll() is None:
        with suppress(FileNotFoundError):
            now = [(path, path.lstat().st_size) for path in folder.rglob("*")]
            count, seen = count + (now != seen), now
        time.sleep(0.001)
    return count


def try_call(place: Path, words: list[str], kills: int, rng: Rng) -> tuple[Counter[str], list[str]]:
    """Kill a call a number of times, run it twice at once; return what came of it and what is wrong."""
    (place / "0").mkdir()
    words = [*words, "--jobs", "2", *make_project(place / "0", int(rng.integers(2**31)))]
    if "--replace" in words:
        ended(start(place / "0", [word for word in words if word != "--replace"]))
    folders = [place / str(number) for number in range(1, kills + 3)]
    for folder in folders:
        shutil.copytree(place / "0", folder)
    whole = start(folders[0], words)
    most = changes(whole, folders[0], np.inf)
    if said := ended(whole):
        raise SystemExit(f"{words}: fails undisturbed: {said}")
    before, after, came, wrong = left(place / "0"), left(folders[0]), Counter[str](), list[str]()
    for number, folder in enumerate(folders[1:]):
        if number == kills:
            refused = list(filter(None, map(ended, [start(folder, words) for _ in range(2)])))
            came["refused"] += len(refused)
            wrong += [f"of two at once: {said}" for said in refused if said.count("\n") != 1]
        else:
            call = start(folder, words)
            changes(call, folder, int(rng.integers(most + 1)))
            time.sleep(rng.exponential(0.01))
            came["killed" if call.poll() is None else "ended before"] += 1
            with suppress(ProcessLookupError):
                os.kill(call.pid if number % 2 else -call.pid, signal.SIGKILL)  # -: its workers, too
            ended(call)
        wrong += lost(folder, before, after)
        if said := ended(start(folder, [*words, "--resume"])):
            wrong.append(f"cannot go on: {said}")
            continue
        found = left(folder)
        wrong += [f"{name} differs" for name in sorted(found | after) if found.get(name) != after.get(name)]
    return came, wrong


def main(*, kills: int = 30, seed: int = 0, out: Target | None = None) -> None:
    """Print a table of what is left after so many kills; exit with 1 if anything is wrong."""
    lines = []
    for number, words in enumerate(CALLS):
        rng = np.random.default_rng([seed, number])
        with tempfile.TemporaryDirectory() as name:
            came, wrong = try_call(Path(name), words.split(), kills // len(CALLS), rng)
        for complaint in wrong:
            print(f"WRONG {words}: {complaint}", flush=True)
        lines.append((words, came["killed"], came["ended before"], came["refused"], len(wrong)))
        print(*lines[-1], sep=", ", flush=True)
    command = f"`python -m tools.robustness.killed_calls --kills {kills} --seed {seed}`"
    head = "command | killed | ended before | of two at once refused | wrong"
    publish(joined(command, table(head, lines)), out)
    raise SystemExit(any(line[-1] for line in lines))


if __name__ == "__main__":
    run(main)
