"""Give every command odd inputs, drawn from a seed, and see whether a call is rude.

    python -m tools.evaluation.fuzz --cases 1000 --seed 0

A case is a folder of photographs, a video, a list, a network, a COLMAP project and its model, with one
oddity (`KINDS`), in which one command runs as a fresh process. A call is rude if it ends by a signal or with
an exit code other than 0, 1 and 2; outlasts `PATIENCE_S`; prints a traceback, a control character, or on
stderr a line that is not its own; fails in silence; changes what was there, but a database that it links to;
writes what it was not asked to; starts another program (traps of known names lie first on PATH); or opens an
internet socket (seen by strace, where it is installed).
"""

import os
import re
import resource
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from itertools import pairwise
from pathlib import Path
from subprocess import PIPE, CompletedProcess
from typing import TypeVar

import cv2
import numpy as np
import pycolmap
from PIL import Image

from blur2view.networks.model_file import shipped_file
from tools.arguments import Target, run
from tools.pages import publish, table

Rng = np.random.Generator
T = TypeVar("T")
ROOT = Path(__file__).parents[2]
PATIENCE_S = 180.0
GOOD, SIZE = "good.jpg", (240, 180)
PROGRAM = (
    "from blur2view.__main__ import program\nif __name__ == '__main__':\n    raise SystemExit(program())\n"
)
TRAPS = ("gs", "djpeg", "convert", "magick", "ffmpeg", "ffprobe", "dcraw", "exiftool", "colmap", "sh", "bash")
OUTPUTS = {"-o", "--csv", "--keep", "--extract", "--db"}  # options that name what a call may write
READING = (  # commands that read photographs; a project or its model
    "estimate -o out", "estimate --csv table.csv", "segment -o out", "report -o page.html",
    "to-colmap --db new.db", "triage --csv table.csv --keep keep.txt", "triage --best 1 --extract best",
)  # fmt: skip
LINK = "to-colmap --db project.db --link --sequence frames"
PLACE = "place linked.db model frames -o placed --fraction 0.4"
SPLAT = "to-transforms views --dialect nerfstudio -o splat/transforms.json"
RECOVER, CAMERA = "recover model frames -o recovered", "estimate --camera project.db:1 frames"
PROJECT = (LINK, PLACE, RECOVER, "to-transforms views -o a.json", SPLAT, CAMERA)
ODD_NAMES = (
    "tcp:127.0.0.1:9?.mp4", "udp:127.0.0.1:9.mp4", "tls:127.0.0.1:9.mp4", "rtsp:127.0.0.1.mp4", "async:a.mp4",
    "http:/127.0.0.1:9/clip.mp4", "ftp:/127.0.0.1/clip.mp4", "concat:clip.mp4", "2024-01-01T12:30:00.mp4",
    "=1+1.jpg", "@good.jpg", "-o.jpg", "a\nb.jpg", "\x1b[31m.jpg", "\u202e.jpg", "a" * 240 + ".jpg", "%s.jpg",
    "<b>.jpg", "a#open.jpg", "..jpg", "*.jpg", "x.dng", "x.heic", "x", "\udcff.jpg", "\udcff.mp4",
)  # fmt: skip
POSTSCRIPT = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 80 64\n%%EndComments\nshowpage\n"
NEW = (  # what stands in a damaged file in place of its own bytes
    b"", b"-1", b"nan", b"1e999", b"9" * 6000, b'"', b"[" * 99_999, b"\0", b"\x1b[2J", b"/dev/zero", b"../x",
    b"cposix\nsystem\n(S'touch RAN'\ntR.", POSTSCRIPT, b"PK\3\4",
    *(struct.pack(f, number) for f in ("<I", ">I", "<d") for number in (0, 1, 2**31, 2**32 - 1)),
)  # fmt: skip
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT * FROM n"
SQL = (
    *(f"ALTER TABLE {t} RENAME TO o; CREATE VIEW {t} AS {ENDLESS}" for t in ("images", "cameras", "matches")),
    "UPDATE images SET image_id = image_id + 5000000000", "UPDATE cameras SET params = zeroblob(3)",
    "UPDATE cameras SET model = 99", "UPDATE keypoints SET rows = 99999999", "DROP TABLE two_view_geometries",
    "UPDATE images SET name = '../victim/' || name", "UPDATE images SET name = CAST(x'ff' AS TEXT)",
    "CREATE TRIGGER t AFTER INSERT ON images BEGIN DELETE FROM images; END", "DELETE FROM cameras",
)  # fmt: skip


def drawn(rng: Rng, choices: Sequence[T]) -> T:
    """Return one of several things, each as likely."""
    return choices[int(rng.integers(len(choices)))]


def mutated(data: bytes, rng: Rng) -> bytes:
    """Return data with one to three parts replaced: as many bytes, none, a word, all that follows."""
    for _ in range(int(rng.integers(1, 4))):
        at, new = int(len(data) ** drawn(rng, (rng.random(), 1.0)) * rng.random()), drawn(rng, NEW)
        word = re.compile(rb"[\w.+-]*").match(data, at)
        data = (
            data[:at] + new + data[drawn(rng, (at + len(new), at, word.end() if word else at, len(data))) :]
        )
    return data


def make_place(place: Path) -> None:
    """Write "whole", a folder of good inputs of every kind, and "bin", with the program and the traps."""
    folder, rng = place / "whole", np.random.default_rng(0)
    for path in (place / "bin", folder / "model", folder / "frames"):
        path.mkdir(parents=True)
    (place / "bin/program").write_text(PROGRAM)
    for name in TRAPS:
        (place / "bin" / name).write_text(f"#!{sys.executable}\nopen({str(place / 'ran')!r}, 'a')\n")
        (place / "bin" / name).chmod(0o755)
    options = pycolmap.SyntheticDatasetOptions(num_rigs=1, num_frames_per_rig=3)
    options.camera_width, options.camera_height = SIZE
    options.camera_params = [1.1 * SIZE[0], SIZE[0] / 2, SIZE[1] / 2, 0.01]
    pycolmap.set_random_seed(0)
    with pycolmap.Database.open(folder / "project.db") as database:
        model = pycolmap.synthesize_dataset(options, database)
    model.write_binary(folder / "model")
    video = cv2.VideoWriter(str(folder / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10, SIZE)
    with Image.open(ROOT / "models/sample.jpg") as sample:
        for name in (GOOD, "other.jpg", *(f"frames/{image.name}" for image in model.images.values())):
            left, top = (int(corner) for corner in rng.integers([40, 50], [100, 140]))
            part = sample.crop((left, top, left + SIZE[0], top + SIZE[1]))
            part.save(folder / name)
            video.write(np.asarray(part)[..., ::-1])
    video.release()
    (folder / "list.txt").write_text(f"# photographs\n{GOOD}\nother.jpg\n")
    (folder / "sidecar.json").write_text('{"model_id": "mine"}')
    shutil.copy(shipped_file("smear.onnx"), folder)
    shutil.copy(folder / "project.db", folder / "linked.db")
    for words in (LINK.replace("project.db", "linked.db --no-backup"), PLACE.replace("placed", "views")):
        if (done := call(folder, words.split())).returncode:
            raise SystemExit(f"{words}: fails with whole inputs: {done.stderr}")


def damaged(folder: Path, rng: Rng) -> list[str]:
    """Damage one input, or put a folder, a pipe or a link in its place; return a command that reads it."""
    ways = [(GOOD, f"{one} {GOOD} other.jpg") for one in READING]
    ways += [("list.txt", f"{READING[1]} @list.txt"), ("clip.mp4", f"{READING[5]} clip.mp4")]
    ways += [("smear.onnx", f"{READING[0]} --model smear.onnx {GOOD}")]
    ways += [("project.db", LINK), ("linked.db", PLACE), ("project.db", CAMERA)]
    ways += [(f"model/{name}.bin", drawn(rng, (PLACE, RECOVER))) for name in ("images", "points3D", "frames")]
    ways += [(f"views/{name}.bin", SPLAT) for name in ("images", "points3D", "cameras")]
    name, words = drawn(rng, ways)
    path, data, way = folder / name, (folder / name).read_bytes(), int(rng.integers(20))
    path.unlink()
    if way == 0:
        path.mkdir()
    elif way == 1:
        os.mkfifo(path)
    elif way == 2:
        path.symlink_to(drawn(rng, ("/dev/zero", "/dev/null", "/", "nowhere", path.name)))
    else:
        path.write_bytes(mutated(data, rng))
    return words.split()


def named(folder: Path, rng: Rng) -> list[str]:
    """Give a photograph or a video an odd name."""
    name = drawn(rng, ODD_NAMES)
    (folder / name).parent.mkdir(exist_ok=True, parents=True)
    shutil.copy(folder / ("clip.mp4" if name.endswith(".mp4") else GOOD), folder / name)
    return [*drawn(rng, READING).split(), "--", GOOD, name]


def colliding(folder: Path, rng: Rng) -> list[str]:
    """Let an output be an input, another file of the user's, or a link to one or to a device."""
    command = drawn(rng, (*READING[1:2], *READING[3:6], LINK, PLACE))
    target = drawn(rng, (GOOD, "list.txt", "clip.mp4", "sidecar.json", "smear.onnx", "model/images.bin"))
    name = drawn(rng, ("link", target))
    if name == "link":
        (folder / name).symlink_to(drawn(rng, (target, "/dev/full", "/dev/null", "nowhere/x", "link")))
    words = command.split()
    words[drawn(rng, [at for at, word in enumerate(words) if word in OUTPUTS]) + 1] = name
    return words if command in PROJECT else [*words, GOOD, "other.jpg"]


def odd_database(folder: Path, rng: Rng) -> list[str]:
    """Change a database as SQLite allows, but COLMAP does not expect."""
    words = drawn(rng, (LINK, PLACE, CAMERA))
    with closing(sqlite3.connect(folder / ("linked.db" if words == PLACE else "project.db"))) as database:
        with suppress(sqlite3.Error):
            database.executescript(drawn(rng, SQL))
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    return words.split()


def plain(_: Path, rng: Rng) -> list[str]:
    """Leave all as it is."""
    command = drawn(rng, (*READING, *PROJECT))
    return command.split() if command in PROJECT else [*command.split(), GOOD, "other.jpg"]


KINDS: dict[str, tuple[float, Callable[[Path, Rng], list[str]]]] = {  # share of the cases, what makes one
    "damage": (0.40, damaged), "odd name": (0.18, named), "collision": (0.14, colliding),
    "database": (0.12, odd_database), "nothing": (0.02, plain), "full disk": (0.09, plain),
    "killed": (0.05, plain),
}  # fmt: skip


def call(
    folder: Path, words: list[str], most_bytes: int = 0, patience_s: float = PATIENCE_S
) -> CompletedProcess[str]:
    """Run a command in a folder, its files limited; kill it after a time, and then what it started, too."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "HOME": str(folder.parent)}
    environment["PATH"] = f"{folder.parent / 'bin'}{os.pathsep}{environment['PATH']}"
    program = [sys.executable, str(folder.parent / "bin/program"), *words]
    if shutil.which("strace") and not most_bytes:
        log = ["-e", "trace=connect,bind", "-o", str(folder.parent / "sockets")]
        program = ["strace", "-f", "-qq", "--seccomp-bpf", *log, *program]
    child = subprocess.Popen(
        program, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=PIPE, stderr=PIPE,
        errors="replace", start_new_session=True,
    )  # fmt: skip
    if most_bytes:
        resource.prlimit(child.pid, resource.RLIMIT_FSIZE, (most_bytes, most_bytes))
    timer = threading.Timer(patience_s, os.killpg, (child.pid, signal.SIGKILL))
    timer.start()
    printed, said = child.communicate()
    timer.cancel()
    return CompletedProcess(words, child.returncode, printed, said)


def snapshot(folder: Path) -> dict[str, object]:
    """Return the bytes of files, the targets of links, and nothing of what else is no folder."""
    paths = [path for path in sorted(folder.rglob("*")) if path.is_symlink() or not path.is_dir()]
    read = [p.readlink() if p.is_symlink() else p.read_bytes() if p.is_file() else None for p in paths]
    return {str(path.relative_to(folder)): content for path, content in zip(paths, read, strict=True)}


def complaints(folder: Path, before: dict[str, object], done: CompletedProcess[str]) -> list[str]:
    """Return what is rude in a call; ``before`` are the files that were there."""
    text, lines, words = done.stdout + done.stderr, done.stderr.splitlines(), done.args
    found = [] if done.returncode in (0, 1, 2) else [f"exit code {done.returncode}"]
    found += [f"traceback {text.strip()[-300:]}"] if "Traceback" in text else []
    found += [f"prints {mark!r}" for mark in sorted(set(text)) if not mark.isprintable() and mark != "\n"]
    found += [f"foreign line {line[:200]}" for line in lines if not line.startswith("blur2view")][:1]
    found += ["fails in silence"] if done.returncode and not lines else []
    asked = tuple(word.split("/")[0] for option, word in pairwise(words) if option in OUTPUTS)
    linked = asked if "--link" in words else ()  # and what lies beside such a database
    after = snapshot(folder)
    for name in before.keys() | after.keys():
        if name in before and before[name] != after.get(name) and not (linked and name.startswith(linked)):
            found.append(f"changes or removes {name}")
        if name not in before and not name.removeprefix(".").startswith((*asked, "blur2view")):
            found.append(f"leaves {name}")
    strays = {path.name for path in folder.parent.iterdir()} - {folder.name, "whole", "bin", "sockets"}
    found += [f"leaves {name} outside" for name in sorted(strays)]
    log = folder.parent / "sockets"
    sockets = [line for line in log.read_text().splitlines() if "AF_INET" in line] if log.exists() else []
    return found + [f"opens a socket: {line}" for line in sockets[:1]]


def try_case(place: Path, seed: int, number: int) -> tuple[str, int, list[str]]:
    """Return the kind of a case, the exit code of its call, and what is rude in it."""
    rng, folder = np.random.default_rng([seed, number]), place / "case"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(place / "whole", folder)
    kind = str(rng.choice(list(KINDS), p=[share for share, _ in KINDS.values()]))
    words = KINDS[kind][1](folder, rng)
    before = snapshot(folder)
    done = None
    if kind == "killed":
        done = call(folder, words, patience_s=float(rng.uniform(0.3, 4)))
        words += ["--resume"] if "out" in words else []
    if done is None or done.returncode:  # else it had ended before it could be killed
        done = call(folder, words, int(10 ** rng.uniform(3.6, 5.7)) if kind == "full disk" else 0)
    found = complaints(folder, before, done)
    found += [f"fails: {done.stderr}"] if kind in ("nothing", "killed") and done.returncode else []
    for name in {path.name for path in place.iterdir()} - {"whole", "bin", "case"}:
        (place / name).unlink()
    return kind, done.returncode, [f"{complaint}: {words}" for complaint in found]


def main(*, cases: int = 1000, seed: int = 0, first: int = 0, out: Target | None = None) -> None:
    """Print every rude call and, also after Ctrl-C, the table of kinds; exit with 1 if a call is rude."""
    codes, rude = Counter[tuple[str, int]](), Counter[str]()
    with tempfile.TemporaryDirectory() as name, suppress(KeyboardInterrupt):
        make_place(Path(name))
        for number in range(first, first + cases):
            kind, code, found = try_case(Path(name), seed, number)
            codes[kind, code] += 1
            rude[kind] += bool(found)
            for complaint in found:
                print(f"RUDE {kind}, --seed {seed} --first {number} --cases 1: {complaint}", flush=True)
    lines = [(kind, *(codes[kind, code] for code in (0, 1, 2)), rude[kind]) for kind in KINDS]
    words = f"Seed {seed}, {codes.total()} cases; `--help` says when a call is rude."
    publish(out, words, table("odd | exit code 0 | 1 | 2 | rude", lines))
    raise SystemExit(bool(rude.total()))


if __name__ == "__main__":
    run(main)
