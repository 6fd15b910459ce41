"""Kill whole calls of the command line at random moments, let two calls write to one place, and go on.

    python -m tools.robustness.kill_commands --count 30

A call over a few photographs is killed with SIGKILL after a random share of the time that it takes, every
second time alone, so that its workers live on, else with them. Nothing of the user's may have changed, every
file of a result must be whole, and the same call with --resume must end with exit code 0 and leave, byte for
byte, what a call leaves that nobody disturbs. The same is asked of two equal calls at once, of which one may
refuse in one line and is then called again. "--link" writes into a project of the user's.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np

from tools.arguments import parser_of, target
from tools.database_safety.colmap_projects import ProjectOptions, make_project, user_rows
from tools.database_safety.kill_writes import contents
from tools.pages import publish, table
from tools.robustness.hostile_files import blurred
from tools.robustness.politeness import damage

CALLS = {
    "estimate": ("estimate", "-o", "out", "--no-timings"),
    "segment": ("segment", "-o", "out", "--no-timings"),
    "triage": ("triage", "--csv", "table.csv", "--keep", "keep.txt", "--no-timings"),
    "to-colmap": ("to-colmap", "--db", "new.db"),
    "to-colmap --link": ("to-colmap", "--link", "--replace", "--no-backup", "--db", "project.db"),
}
PHOTOGRAPHS, SIZE, PROJECT = 4, (128, 96), "project.db"
ROOT = Path(__file__).parents[2]
MANIFEST = ".manifest.jsonl"  # the order of its lines is that in which photographs were done


def prepare(folder: Path) -> list[str]:
    """Put photographs and a project that holds them into a new folder; return their names."""
    folder.mkdir()
    names = make_project(folder / PROJECT, ProjectOptions(images=PHOTOGRAPHS, size=SIZE))
    for number, name in enumerate(names):
        blurred(np.random.default_rng(number), SIZE).save(folder / name, "JPEG", quality=95)
    return names


def start(folder: Path, words: tuple[str, ...]) -> subprocess.Popen[bytes]:
    """Start a call in a folder, in a group of processes of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "blur2view", *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def ended(call: subprocess.Popen[bytes]) -> tuple[int, str]:
    """Return the exit code of a call and what it said."""
    said = call.communicate()[1].decode(errors="replace")
    return call.returncode, said


def left(folder: Path) -> dict[str, object]:
    """Return what a folder holds: bytes of files, rows of databases; no manifests."""
    files = {str(path.relative_to(folder)): path for path in sorted(folder.rglob("*")) if path.is_file()}
    files = {name: path for name, path in files.items() if not name.endswith((MANIFEST, "-wal", "-shm"))}
    return {
        name: contents(path) if path.suffix == ".db" else path.read_bytes() for name, path in files.items()
    }


def lost(folder: Path, untouched: Path) -> list[str]:
    """Return what of the user's is changed, and which results are not whole."""
    whole = [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")]
    found = [f"{path.name} {why}" for path in whole if path.suffix != ".db" and (why := damage(path))]
    if user_rows(folder / PROJECT) != user_rows(untouched / PROJECT):
        found.append("rows of the user's changed")
    photographs = untouched.glob("*.jpg")
    return found + [one.name for one in photographs if one.read_bytes() != (folder / one.name).read_bytes()]


def gone_on(folder: Path, words: tuple[str, ...], expected: dict[str, object]) -> list[str]:
    """Call again and return in what the folder is not as after a call that nobody disturbs."""
    code, said = ended(start(folder, words))
    if code != 0:
        return [f"cannot go on: {said}"]
    found = left(folder)
    return [
        f"{name} differs" for name in found.keys() | expected.keys() if found.get(name) != expected.get(name)
    ]


def killed(folder: Path, words: tuple[str, ...], delay_s: float, alone: bool) -> str:
    """Kill a call after a delay, alone or with its workers; return whether it had ended by then."""
    call = start(folder, words)
    time.sleep(delay_s)
    state = "ended before" if call.poll() is not None else "killed"
    with suppress(ProcessLookupError):
        if alone:
            call.kill()
        else:
            os.killpg(call.pid, signal.SIGKILL)
    call.communicate()  # until its workers are gone, too: they hold its stderr
    return state


def try_call(
    place: Path, command: str, count: int, rng: np.random.Generator
) -> tuple[Counter[str], list[str]]:
    """Kill a command a number of times, call it twice at once; return what came of it and what is wrong."""
    names, wrong, states = prepare(place / "untouched"), [], Counter[str]()
    words = (*CALLS[command], "--jobs", "2", *names)
    shutil.copytree(place / "untouched", place / "whole")
    begin = time.perf_counter()
    if (done := ended(start(place / "whole", words)))[0] != 0:
        raise SystemExit(f"{command}: fails undisturbed: {done[1]}")
    duration_s = time.perf_counter() - begin
    expected, again = left(place / "whole"), (*words, "--resume")
    for number in range(count):
        folder = place / str(number)
        shutil.copytree(place / "untouched", folder)
        states[killed(folder, words, float(rng.uniform(0.1, 1)) * duration_s, number % 2 == 0)] += 1
        wrong += lost(folder, place / "untouched") + gone_on(folder, again, expected)
    folder = place / "two"
    shutil.copytree(place / "untouched", folder)
    pair = [ended(call) for call in [start(folder, words) for _ in range(2)]]
    refused = [said for code, said in pair if code != 0]
    states["one of two refused"] += len(refused)
    wrong += [f"of two at once: {said}" for said in refused if said.count("\n") != 1]
    wrong += lost(folder, place / "untouched") + gone_on(folder, again, expected)
    return states, wrong


def main() -> None:
    """Print a table of what was left; exit with 1 if anything is wrong."""
    parser = parser_of(__doc__)
    parser.add_argument("--count", type=int, default=30, help="kills, of all commands")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=target, help="write the table there, too")
    options = parser.parse_args()
    rng, rows, bad = np.random.default_rng(options.seed), [], 0
    for command in CALLS:
        with tempfile.TemporaryDirectory() as name:
            states, wrong = try_call(Path(name), command, options.count // len(CALLS), rng)
        for complaint in wrong:
            print(f"WRONG {command}: {complaint}", flush=True)
        two = "one refused" if states["one of two refused"] else "both done"
        rows.append((command, states["killed"], states["ended before"], two, len(wrong)))
        print(*rows[-1], sep=", ", flush=True)
        bad += len(wrong)
    words = f"`python -m tools.robustness.kill_commands --count {options.count} --seed {options.seed}`"
    head = "command | killed | ended before | two at once | wrong"
    publish("\n".join([words, "", *table(head, rows), ""]), options.out)
    raise SystemExit(bool(bad))


if __name__ == "__main__":
    main()
