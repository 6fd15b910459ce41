"""What a call of the command line must not do, whatever it is given."""

import csv
import json
import sqlite3
import zipfile
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from blur2view.errors import Blur2ViewError
from tools.database_safety.colmap_check import check_database

MOST_S, MOST_GIB = 20.0, 2.0
ENDINGS = {"estimate": (".json", ".png", ".smear.npz"),
           "segment": (".mask.png", ".moving.png", ".motion.png", ".motion.json")}  # fmt: skip
STREAMS = {".stdout", ".stderr"}
EXTRACTED = "frames"  # copies of photographs, whole or not
AGAIN = "done again"  # how a line ends that tells of a damaged manifest, which is no failure
# of a list
UNREAD = ("the list cannot be read", "names no photograph", "photographs in one call", "beside the list")


@dataclass(frozen=True, kw_only=True)
class Call:
    """A call of the command line and what came of it; ``code`` None if it had to be ended.

    ``photographs`` are the inputs, the first of which is good, and all of them if they are ``counted``;
    ``folder`` is where it ran; ``seconds`` are of a processor, its own and its processes'.
    """

    words: list[str]
    folder: Path
    photographs: list[Path]
    code: int | None
    printed: bytes
    said: bytes
    seconds: float
    peak_gib: float
    counted: bool = True

    @property
    def lines(self) -> list[str]:
        """Return what stands on stderr."""
        return self.said.decode("utf-8", "replace").split("\n")[:-1]


def complaints(call: Call, *, full_disk: bool = False, prepared: bool = False) -> list[str]:
    """Return everything that is wrong with a call, an empty list if nothing is.

    On a full disk no results need be there; where a folder was prepared, other files were there before, of
    which nobody knows whether they are whole.
    """
    found = [*_ending(call), *_streams(call), *([] if prepared else _files(call))]
    alone = call.counted and len(call.photographs) == 1
    if call.code in (0, 1) and not (full_disk or prepared or alone):
        try:
            found += _undone(call)
        except (OSError, ValueError, KeyError, sqlite3.Error) as error:
            found.append(f"its results cannot be counted: {error}")
    return found


def _ending(call: Call) -> Iterator[str]:
    if call.code is None:
        yield "hangs, and had to be ended"
    elif call.code not in (0, 1, 2):
        yield f"exit code {call.code}"
    if call.seconds > MOST_S:
        yield f"takes {call.seconds:.0f} s of a processor"
    if call.peak_gib > MOST_GIB:
        yield f"takes {call.peak_gib:.2f} GiB"


def _streams(call: Call) -> Iterator[str]:
    """Complain about foreign lines, control characters, and lines that are too many or too few."""
    if b"Traceback" in call.said + call.printed:
        stream = call.said if b"Traceback" in call.said else call.printed
        yield "traceback: " + stream.decode("utf-8", "replace").strip().split("\n")[-1]
        return
    text = (call.said + call.printed).decode("utf-8", "replace")
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
    if bool([line for line in call.lines if not line.endswith(AGAIN)]) != (call.code == 1):
        yield f"exit code {call.code} with {len(call.lines)} lines on stderr"
    if call.counted and len(call.lines) > len(call.photographs):
        yield f"{len(call.lines)} lines about {len(call.photographs)} photographs"


def _files(call: Call) -> Iterator[str]:
    """Complain about files that are not whole, are temporary, or lie where nothing was asked for."""
    there = [path for path in sorted(call.folder.rglob("*")) if path.name not in STREAMS]
    for path in there:
        hidden = path.name.startswith(".") and not path.name.startswith("..")  # which a photograph may be
        if hidden or path.suffix in (".tmp", ".bak") or path.name.endswith("-journal"):
            yield f"leaves {path.relative_to(call.folder)}"
        elif path.relative_to(call.folder).parts[0] == EXTRACTED:
            continue
        elif path.is_file() and not path.is_symlink() and (why := damage(path)):
            yield f"{path.relative_to(call.folder)} {why}"
    endings = ENDINGS.get(call.words[0], ())
    for stem in {
        str(path).removesuffix(ending) for ending in endings for path in there if path.name.endswith(ending)
    }:
        if missing := [ending for ending in endings if not Path(stem + ending).exists()]:
            yield f"leaves {Path(stem).name} without {', '.join(missing)}"
    if call.code == 2 and len(there) > 1:
        yield f"writes {there[-1].name} in spite of wrong usage"


def damage(path: Path) -> str:
    """Return what is wrong with a result; nothing of a file of another kind."""
    data = path.read_bytes()
    try:
        match path.suffix:
            case ".json":
                json.loads(data)
            case ".npz":
                with zipfile.ZipFile(path) as archive:
                    return f"has a damaged {bad}" if (bad := archive.testzip()) else ""
            case ".html":
                return "" if data.rstrip().endswith(b"</html>") else "is cut"
            case ".png":
                return "" if data.endswith(b"IEND\xaeB`\x82") else "is cut"
            case ".db":
                return "; ".join(check_database(path))
    except (ValueError, OSError, zipfile.BadZipFile, sqlite3.Error, Blur2ViewError) as error:
        return f"is damaged: {error}"
    return ""


def _undone(call: Call) -> Iterator[str]:
    """Complain where photographs without a line on stderr have no result."""
    if not call.counted and any(told in line for told in UNREAD for line in call.lines):
        return  # a call whose list cannot be read does nothing
    expected = len({path.as_posix() for path in call.photographs}) - len(call.lines)
    command, out = call.words[0], call.folder / "out"
    if "--json" in call.words:
        document = json.loads(call.printed)
        done = len(document["estimates"])
        if len(document["failures"]) != len(call.lines):
            yield f"{len(document['failures'])} failures in JSON, {len(call.lines)} lines"
    elif "--jsonl" in call.words:
        done = sum("error" not in json.loads(line) for line in call.printed.splitlines())
    elif command in ENDINGS:
        done = len(list(out.rglob(f"*{ENDINGS[command][-1]}")))
    elif command == "report":
        page = call.folder / "page.html"
        done = page.read_bytes().count(b'id="photo-data-') if page.exists() else 0
    elif command == "triage":
        csv.field_size_limit(1 << 30)
        with (call.folder / "table.csv").open(newline="", errors="surrogateescape") as table:
            done = sum(not row["error"] for row in csv.DictReader(table))
    else:
        with closing(sqlite3.connect(call.folder / "new.db")) as database:
            done = database.execute("SELECT count(*) FROM images").fetchone()[0] // 2
    if not done or call.counted and done != expected:
        yield f"{done} photographs done, {expected} expected"
