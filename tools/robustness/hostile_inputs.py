"""Damage inputs of every kind, give them to the commands that read them, and see whether these stay polite.

    python -m tools.robustness.hostile_inputs --cases 1000 --seed 0

Each case is drawn from the seed and its number: a kind of input, one of its files (several photographs,
beside a good one), damage to its bytes or another thing in its place, and a command. "results" are
what an earlier call left. Each call is a fresh interpreter.

A call is polite if it ends by itself within 20 seconds of processor time, 180 of any, and 2 GiB, with exit
code 0, 1 or 2; prints nothing but its own lines, one for each failure; leaves nothing but whole results where
it was asked to; does all that it does not refuse; starts no other program (traps of their names lie first on
PATH) and runs nothing that a file says; and changes no byte of its
inputs, of a database that it links to no row of the user's. Ctrl-C ends with the table of what is done.
"""

import contextlib
import os
import resource
import shutil
import signal
import tempfile
import threading
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tools.arguments import Target, run
from tools.pages import joined, publish, table
from tools.robustness.corpus import GOOD, OTHER, TRAPS, make_corpus, set_traps, start
from tools.robustness.mutations import Rng, damage, drawn
from tools.robustness.politeness import MOST_S, Call, complaints, rows, snapshot

PATIENCE_S = 180.0  # of any time; a call shares the machine with others
MORE = 4  # damaged photographs in a call
COMMANDS = [
    f"{words} --csv table.csv"
    for words in (
        "estimate --no-timings -o out", "estimate --no-timings --sequence --json",
        "estimate --no-timings --jsonl", "segment --no-timings --masks colmap -o out",
        "report --no-timings -o page.html", "to-colmap --db new.db", "triage --no-timings --keep keep.txt",
        "triage --no-timings --best 50% --extract extracted",
    )
]  # fmt: skip
FRAME = "frames/camera000001_frame000001.png"
NAMES = (
    "a b.jpg", "\n.jpg", "\x1b[31m.png", "ü.jpg", "-o.jpg", "#open.jpg", "a#close.png", "%s.jpg", "a,b.jpg",
    "..jpg", "'.jpg", '".jpg', "\u202e.jpg", "a" * 240 + ".jpg", os.fsdecode(b"\xff\xfe.jpg"), "<b>.jpg",
    "&amp;.png", "<!--.jpg", "$HOME.jpg", "*.jpg", "x.dng", "x.heic", "x.txt", "x", "x.JPG", "x.tif",
)  # fmt: skip


class Kind(NamedTuple):
    """A kind of input: its share of all, its files in the corpus, and the commands that read them.

    "{}" in commands, and in further words, is the damaged file, or the folder that it lies in;
    ``photographs`` is how many are named, None if nobody knows.
    """

    share: float
    files: str = ""
    commands: Sequence[str] = COMMANDS
    more: Sequence[str] = ("",)
    photographs: int | None = 1


KINDS = {
    "photographs": Kind(0.3, photographs=1 + MORE),
    "lists": Kind(0.08, "list.txt", more=[f"{GOOD} @{{}}", f"{GOOD} -"], photographs=None),
    "videos": Kind(0.1, "clip.*", more=[f"--every 4 {GOOD} {{}}"], photographs=None),
    "networks": Kind(0.1, "smear.onnx", more=[f"--model {{}} {GOOD}"]),
    "databases": Kind(0.16, "project.db journal.db linked.db", [
        f"to-colmap --link --db {{}} {FRAME}", f"to-colmap --link --no-backup --json --db {{}} {FRAME}",
        f"estimate --json --camera {{}}:1 {FRAME}", f"estimate --json --camera {{}} {FRAME}",
        "place {} model frames --fraction 0.4 -o out"]),
    "models": Kind(0.14, "model/* model_text/* views/* views_text/*", [
        "place linked.db {} frames --fraction 0.4 -o out", "to-transforms {} --images frames -o out/a.json",
        "to-transforms {} --dialect nerfstudio --exposure 0.02 --images frames -o out/a.json"]),
    "results": Kind(
        0.1, ".*manifest.jsonl out/**/* extracted/* table.csv keep.txt page.html new.db",
        [words for words in COMMANDS if "--json" not in words],
        [f"{way} {GOOD} {OTHER}" for way in ("--resume", "--overwrite")], photographs=2),
    "full disks": Kind(0.02, more=[GOOD]),
}  # fmt: skip


def make_case(corpus: Path, folder: Path, rng: Rng) -> tuple[str, list[str]]:
    """Put the inputs of a case into a new folder, some of them damaged; return its kind and its words."""
    name = str(rng.choice(list(KINDS), p=[kind.share for kind in KINDS.values()]))
    kind = KINDS[name]
    shutil.copytree(corpus, folder, ignore=shutil.ignore_patterns("pictures"))
    words = f"{drawn(rng, kind.commands)} {drawn(rng, kind.more)}".split()
    if name == "photographs":
        words += ["--", GOOD, *_photographs(corpus / "pictures", folder, rng)]
    if name == "results":
        earlier = run_call([word for word in words if word not in ("--resume", "--overwrite")], folder)
        if earlier.code != 0:
            raise SystemExit(f"{words}: fails with good photographs: {earlier.said.decode()}")
    if kind.files:
        found = [sorted(path for path in folder.glob(one) if path.is_file()) for one in kind.files.split()]
        path = drawn(rng, drawn(rng, [paths for paths in found if paths]))
        damage(path, rng)
        words = [word.replace("{}", path.relative_to(folder).parts[0]) for word in words]
    alone = [] if words[0] in ("place", "to-transforms") else ["--jobs", "1"]
    return name, [words[0], *alone, *words[1:]]


def _photographs(pictures: Path, folder: Path, rng: Rng) -> list[str]:
    """Put damaged photographs into a folder, a few of them whole but odd; return their names."""
    names = []
    for number, picture in enumerate(rng.choice(sorted(pictures.iterdir()), MORE, replace=False)):
        names.append(f"{number}{picture.name}.jpg" if rng.random() < 0.7 else f"{number}/{drawn(rng, NAMES)}")
        path = folder / names[-1]
        path.parent.mkdir(exist_ok=True)
        shutil.copy(picture, path)
        if rng.random() < 0.85:
            damage(path, rng)
    return names


def run_call(words: list[str], folder: Path, kind: str = "results", largest: int | None = None) -> Call:
    """Return what a call did in a folder, in a process of its own.

    A word "-" makes the list its standard input; no file may become larger than ``largest`` bytes.
    """
    before, database = snapshot(folder), folder / dict(pairwise(words)).get("--db", "none")
    kept = rows(database) if "--link" in words else set()
    listed, mark = folder / ("list.txt" if "-" in words else "none"), folder.parent / TRAPS / "ran"
    stdin = listed if listed.is_file() or listed.is_char_device() else Path(os.devnull)
    with tempfile.TemporaryFile() as printed, tempfile.TemporaryFile() as said, stdin.open("rb") as stream:
        child = start(folder, words, stdin=stream, stdout=printed, stderr=said)
        resource.prlimit(child.pid, resource.RLIMIT_CPU, (int(MOST_S) + 1, int(MOST_S) + 2))
        if largest is not None:
            resource.prlimit(child.pid, resource.RLIMIT_FSIZE, (largest, largest))
        patience = threading.Timer(PATIENCE_S, os.killpg, (child.pid, signal.SIGKILL))
        patience.start()
        _, status, usage = os.wait4(child.pid, 0)
        patience.cancel()
        with contextlib.suppress(ProcessLookupError):  # and the processes that it started
            os.killpg(child.pid, signal.SIGKILL)
        child.returncode = os.waitstatus_to_exitcode(status)
        texts = [(stream.seek(0), stream.read())[1] for stream in (printed, said)]
    ran = tuple(mark.read_text().split()) if mark.exists() else ()
    mark.unlink(missing_ok=True)
    return Call(
        words=words, folder=folder, before=before, code=child.returncode, printed=texts[0], said=texts[1],
        seconds=usage.ru_utime + usage.ru_stime, peak_gib=usage.ru_maxrss / 2**20, ran=ran,
        photographs=KINDS[kind].photographs, lost=len(kept - rows(database)) if kept else 0,
        whole=largest is None and kind != "results",
    )  # fmt: skip


Tried = tuple[str, int, list[str]]
"""The kind of a case, the exit code of its call, and what is wrong with it."""


def try_all(cases: Sequence[int], seed: int) -> list[Tried]:
    """Return what came of the cases of these numbers, or of those before Ctrl-C."""
    tried: list[Tried] = []
    with tempfile.TemporaryDirectory() as name, contextlib.suppress(KeyboardInterrupt):
        corpus, folder = Path(name) / "corpus", Path(name) / "case"
        set_traps(Path(name) / TRAPS)
        make_corpus(corpus, seed)
        for number in cases:
            rng = np.random.default_rng([seed, number])
            kind, words = make_case(corpus, folder, rng)
            largest = int(10 ** rng.uniform(3.6, 5.7)) if kind == "full disks" else None
            call = run_call(words, folder, kind, largest)
            tried.append((kind, call.code, complaints(call)))
            shutil.rmtree(folder)
            for complaint in tried[-1][2]:
                print(f"RUDE {kind}, --seed {seed} --only {number}: {complaint}: {words}", flush=True)
            if len(tried) % 20 == 0:
                print(f"{len(tried)} of {len(cases)} cases", flush=True)
    return tried


def main(*, cases: int = 1000, seed: int = 0, only: int | None = None, out: Target | None = None) -> None:
    """Print every rude call and the table; exit with 1 if there is one. ``only`` is the number of a case."""
    tried, lines = try_all(range(cases) if only is None else [only], seed), []
    for kind in [*KINDS, "all"]:
        some = [one for one in tried if kind in (one[0], "all")]
        codes, rude = Counter(code for _, code, _ in some), sum(bool(found) for _, _, found in some)
        lines.append((kind, len(some), f"{codes[0]}, {codes[1]}, {codes[2]}", rude))
    words = f"Seed {seed}, {len(tried)} cases; `--help` says when a call is rude."
    publish(joined(words, table("hostile | calls | exit codes 0, 1, 2 | rude", lines)), out)
    raise SystemExit(any(rude for _, _, rude in tried))


if __name__ == "__main__":
    run(main)
