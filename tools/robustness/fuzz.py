"""Give every command odd inputs, drawn from a seed, and see whether a call is rude.

    python -m tools.robustness.fuzz --cases 1000 --seed 0

A case is a folder of photographs, a video, a list, a network, a COLMAP project and its model, a scene, with
one oddity (`KINDS`), in which one command, or one function of the library, runs as a fresh process. A call is
rude if it ends by a signal or with an exit code other than 0, 1 and 2; outlasts `PATIENCE_S`; prints a
traceback, a control character, or on stderr a line that is not its own; fails in silence; changes what was
there, but a database that it links to; or writes what it was not asked to.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np

from blur2view.cli.recover import NOTES as RECOVERING
from tools.command import Target, publish, run, table
from tools.robustness.odd_arguments import WRITTEN
from tools.robustness.odd_inputs import KINDS, LITTLE, OUTPUTS, ROOT, SCENE, drawn, make_inputs

PATIENCE_S = 180.0


def read_start(path: Path) -> bytes:
    """Return a file's content, of a sparse one that fits no memory its start."""
    with path.open("rb") as file:
        return file.read(1 << 26)


def snapshot(folder: Path) -> dict[str, object]:
    """Return the bytes of files and the targets of links by their names; None of devices and pipes."""
    paths = [path for path in sorted(folder.rglob("*")) if path.is_symlink() or not path.is_dir()]
    read = [p.readlink() if p.is_symlink() else read_start(p) if p.is_file() else None for p in paths]
    return {str(path.relative_to(folder)): content for path, content in zip(paths, read, strict=True)}


def complaints(
    folder: Path, before: dict[str, object], words: list[str], done: subprocess.CompletedProcess[str]
) -> list[str]:
    """Return a line for each rudeness of a call; ``before`` is the `snapshot` from before it."""
    text, lines = done.stdout + done.stderr, done.stderr.splitlines()
    found = [] if done.returncode in (0, 1, 2) else [f"exit code {done.returncode}"]
    found += [f"traceback {text.strip()[-300:]}"] if "Traceback" in text else []
    found += [f"prints {mark!r}" for mark in sorted(set(text)) if not mark.isprintable() and mark != "\n"]
    found += [f"foreign line {line[:200]}" for line in lines if not line.startswith("blur2view")][:1]
    found += ["fails in silence"] if done.returncode and not lines else []
    asked = tuple(word.split("/")[0] for option, word in pairwise(words) if option in OUTPUTS)
    asked += WRITTEN if words[0].isdecimal() else ()  # the seed of a call of the library
    going_on = {"--link", "--resume"} & set(words) or words[:3] == SCENE.split()[:3] and "scene" in words
    linked = asked if going_on else ()  # and files beside that database
    after = snapshot(folder)
    for name in before.keys() | after.keys():
        own = name.endswith(RECOVERING) or (linked and name.startswith(linked))
        if name in before and before[name] != after.get(name) and not own:
            found.append(f"changes or removes {name}")
        if name not in before and not name.removeprefix(".").startswith((*asked, "blur2view")):
            found.append(f"leaves {name}")
    strays = {path.name for path in folder.parent.iterdir()} - {folder.name, "whole"}
    return found + [f"leaves {name} outside" for name in sorted(strays)]


def try_case(place: Path, seed: int, number: int) -> tuple[str, list[str]]:
    """Return the kind of a case and the complaints about its call; ``place`` has good inputs in "whole"."""
    rng, folder = np.random.default_rng([seed, number]), place / "case"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(place / "whole", folder)
    kind = drawn(rng, list(KINDS))
    words = KINDS[kind](folder, rng)
    before = snapshot(folder)
    limit = ["prlimit", f"--as={int(rng.integers(200, 900)) << 20}"] if kind == LITTLE else []
    module = "tools.robustness.odd_arguments" if kind == "library" else "blur2view"
    program = [*limit, "timeout", "-s", "KILL", str(PATIENCE_S), sys.executable, "-m", module, *words]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "HOME": str(place)}
    done = subprocess.run(
        program, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, errors="replace"
    )
    return kind, [f"{complaint}: {words}" for complaint in complaints(folder, before, words, done)]


def main(*, cases: int = 1000, seed: int = 0, first: int = 0, out: Target | None = None) -> None:
    """Print every rude call and the table of kinds; exit with 1 if a call is rude."""
    tried, rude = Counter[str](), Counter[str]()
    with tempfile.TemporaryDirectory() as name, suppress(KeyboardInterrupt):
        make_inputs(Path(name) / "whole")
        for number in range(first, first + cases):
            kind, found = try_case(Path(name), seed, number)
            tried[kind] += 1
            rude[kind] += bool(found)
            for complaint in found:
                print(f"RUDE {kind}, --seed {seed} --first {number} --cases 1: {complaint}", flush=True)
    words = f"Seed {seed}, {tried.total()} cases; `--help` explains when a call is rude."
    publish(out, words, table("inputs | cases | rude", [(kind, tried[kind], rude[kind]) for kind in KINDS]))
    raise SystemExit(bool(rude.total()))


if __name__ == "__main__":
    run(main)
