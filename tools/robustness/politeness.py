"""What a call of the command line must not do, whatever it is given."""

import csv
import json
import shutil
import sqlite3
import zipfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

MOST_S, MOST_GIB = 20.0, 2.0
ENDINGS = {"estimate": (".json", ".png", ".smear.npz"),
           "segment": (".mask.png", ".moving.png", ".motion.png", ".motion.json")}  # fmt: skip
OUTPUTS = {"-o", "--db", "--csv", "--keep", "--extract"}  # options that name what a call may write
MANIFEST = ".manifest.jsonl"  # the end of a hidden file beside results
AGAIN = "done again"  # how a line ends that tells of a damaged manifest, which is no failure
# of a list
UNREAD = ("the list cannot be read", "names no photograph", "photographs in one call", "beside the list")


@dataclass(frozen=True, kw_only=True)
class Call:
    """A call of the command line and what came of it; one that had to be ended has a ``code`` below 0.

    ``photographs`` is how many it names, the first of them good, None if nobody knows. ``before`` is a
    snapshot of its folder, ``lost`` counts rows of a database that are gone, ``ran`` are other programs that
    it started. ``whole`` is False where results
    may be missing: the disk was full, or an earlier call left others. ``seconds`` are of a processor.
    """

    words: list[str]
    folder: Path
    before: dict[str, object]
    code: int
    printed: bytes
    said: bytes
    seconds: float
    peak_gib: float
    photographs: int | None = 1
    lost: int = 0
    ran: tuple[str, ...] = ()
    whole: bool = True

    @property
    def lines(self) -> list[str]:
        """Return what stands on stderr."""
        return self.said.decode("utf-8", "replace").split("\n")[:-1]


def complaints(call: Call) -> list[str]:
    """Return everything that is wrong with a call, an empty list if nothing is."""
    found = [] if call.code in (0, 1, 2) else [f"exit code {call.code}"]
    found += [f"starts {name}" for name in call.ran]
    if call.seconds > MOST_S or call.peak_gib > MOST_GIB:
        found.append(f"takes {call.seconds:.0f} s of a processor, {call.peak_gib:.2f} GiB")
    found += [*_streams(call), *_files(call)]
    if call.code in (0, 1) and call.whole and call.photographs != 1:
        try:
            found += _undone(call)
        except (OSError, ValueError, KeyError) as error:
            found.append(f"its results cannot be counted: {error}")
    return found


def _streams(call: Call) -> Iterator[str]:
    """Complain about foreign lines, control characters, and lines that are too many or too few."""
    text = (call.said + call.printed).decode("utf-8", "replace")
    if "Traceback" in text:
        yield f"traceback: {text.strip()[-300:]}"
        return
    if odd := sorted({mark for mark in text if not mark.isprintable() and mark != "\n"}):
        yield f"prints control characters {odd}"
    if call.said and not call.said.endswith(b"\n"):
        yield "its last line on stderr is not whole"
    if call.code == 2:
        if len(call.lines) != 1 or not call.lines[0].endswith(" --help)"):
            yield f"its usage error is none: {call.lines[-1:]}"
        return
    if foreign := [line for line in call.lines if not line.startswith("blur2view: ")]:
        yield f"foreign line: {foreign[0]}"
    if any(not line.endswith(AGAIN) for line in call.lines) != (call.code == 1):
        yield f"exit code {call.code} with {len(call.lines)} lines on stderr"
    if call.photographs is not None and len(call.lines) > call.photographs:
        yield f"{len(call.lines)} lines about {call.photographs} photographs"


def snapshot(folder: Path) -> dict[str, object]:
    """Return what a folder holds: the bytes of files, kinds and targets of what else is no folder."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_symlink() or not (path.is_dir() or path.is_file()):
            found[name] = (path.lstat().st_mode, path.is_symlink() and path.readlink())
        elif path.is_file():
            found[name] = path.read_bytes()
    return found


def _files(call: Call) -> Iterator[str]:
    """Complain about files that are not whole, are temporary, or that nothing was to be written to."""
    after = snapshot(call.folder)
    outputs = tuple(word.split("/")[0] for option, word in pairwise(call.words) if option in OUTPUTS)
    linked = "--link" in call.words and call.code == 0
    new = [name for name, content in after.items() if content != call.before.get(name)]
    yield from (f"removes {name}" for name in call.before if name not in after and not name.endswith("-shm"))
    if call.lost:
        yield f"{call.lost} rows of the user's are gone"
    for name in new:
        path, last = call.folder / name, name.rpartition("/")[2]
        hidden = last.startswith(".") and not last.startswith("..")  # which a photograph may be
        hidden, named = hidden and not last.endswith(MANIFEST), name.removeprefix(".")
        if hidden or last.endswith((".tmp", "-journal")) or not named.startswith(outputs):
            yield f"{'changes' if name in call.before else 'leaves'} {name}"
        elif "--link" in call.words:
            if not linked:
                yield f"exit code {call.code}, but {name} changed"
        elif "--extract" not in call.words and path.is_file() and (why := flaw(path)):
            yield f"{name} {why}"
    endings = ENDINGS.get(call.words[0], ()) if call.whole else ()
    for stem in {name.removesuffix(end) for end in endings for name in new if name.endswith(end)}:
        if missing := [ending for ending in endings if stem + ending not in after]:
            yield f"leaves {stem} without {', '.join(missing)}"
    if call.code == 2 and new:
        yield f"writes {new[-1]} in spite of wrong usage"


def flaw(path: Path) -> str:
    """Return what is wrong with a result; nothing of a file of another kind."""
    data = path.read_bytes()
    try:
        match path.suffix:
            case ".json":
                json.loads(data)
            case ".npz":
                with zipfile.ZipFile(path) as archive:
                    return f"has a damaged {bad}" if (bad := archive.testzip()) else ""
            case ".html" | ".png":
                return "" if data.rstrip().endswith((b"</html>", b"IEND\xaeB`\x82")) else "is cut"
            case ".db":
                with copied(path) as database:
                    found = database.execute("PRAGMA integrity_check").fetchall()
                    found += database.execute("PRAGMA foreign_key_check").fetchall()
                return "" if found == [("ok",)] else f"is damaged: {found}"
    except (ValueError, OSError, zipfile.BadZipFile, sqlite3.Error) as error:
        return f"is damaged: {error}"
    return ""


@contextmanager
def copied(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a copy of a database with its log: what lies beside the database stays as it is."""
    with TemporaryDirectory() as name:
        for end in ("", "-wal", "-journal"):
            if (beside := Path(f"{path}{end}")).is_file():
                shutil.copyfile(beside, f"{name}/copy{end}")
        with closing(sqlite3.connect(f"{name}/copy")) as database:
            yield database


def rows(path: Path) -> set[tuple[object, ...]]:
    """Return the rows of all tables of a database but SQLite's own; none if it cannot be read."""
    with suppress(sqlite3.Error, UnicodeDecodeError, OverflowError, OSError), copied(path) as database:
        database.text_factory = bytes
        names = database.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
        tables = [table.decode() for (table,) in names if table != b"sqlite_sequence"]
        return {(table, *row) for table in tables for row in database.execute(f'SELECT * FROM "{table}"')}
    return set()


def _undone(call: Call) -> Iterator[str]:
    """Complain where a photograph is neither done nor refused, going by the table of all."""
    if call.photographs is None and any(told in line for told in UNREAD for line in call.lines):
        return  # a call whose list cannot be read does nothing
    with (call.folder / "table.csv").open(newline="", errors="surrogateescape") as table:
        done = sum(not row["error"] for row in csv.DictReader(table))
    expected = (call.photographs or 0) - len(call.lines)
    if not done or call.photographs is not None and done != expected:
        yield f"{done} photographs done, {expected} expected"
    endings = ENDINGS.get(call.words[0], ()) if "-o" in call.words else ()
    if endings and len(list(call.folder.glob(f"out/**/*{endings[-1]}"))) != done:
        yield f"not every photograph of {done} has its {endings[-1]}"
