"""Files of results: planned before any work, each written whole or not at all."""

import errno
import os
import tempfile
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from blur2view.errors import OutputError
from blur2view.input_files import open_regular, parse_json

SIGNED_BY = "blur2view"  # the PNG text "Software"
# What results hold: a key of JSON documents, the first array of an NPZ file, PNG's text, the report's tag,
# the head of a table
SIGNS = {
    ".json": (b'"model_id":', b'"generator": "blur2view '),
    ".npz": (b"smear_grid.npy", b"displacement.npy"),
    ".png": (b"Software\0" + SIGNED_BY.encode(),),
    ".html": (b'name="generator" content="blur2view ',),
    ".ply": (f"comment {SIGNED_BY}\n".encode(),),
    ".csv": (b"name,verdict,parallax,",),
}
DOCUMENT = b'{\n  "image": "'  # how one of a photograph begins
# of one file, whatever it is called
KINDS = {"page": ".html", "table": ".csv", "file": ".json", "point cloud": ".ply"}


def is_there(path: str | Path) -> bool:
    """Return whether there is a file or, below it, a frame of a video."""
    return os.path.isfile(path) or os.path.isfile(os.path.dirname(path))


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write files beside their paths first, then rename them, so that a reader never sees half a file.

    The last of several marks that all are complete: an old one is removed before the first rename. If a file
    cannot be written the old files stay as they were.
    """
    try:
        for path, content in files.items():
            half_written(path).write_bytes(content)
        if len(files) > 1:
            list(files)[-1].unlink(missing_ok=True)
        for path in files:
            half_written(path).replace(path)
    finally:
        for path in files:
            half_written(path).unlink(missing_ok=True)


def remove_left_over(paths: Container[Path], folders: Iterable[Path]) -> None:
    """Remove what processes that were killed left beside these files, half written."""
    for folder in folders:
        for beside in folder.glob(".*.*.tmp"):
            name, _, number = beside.name.removeprefix(".").removesuffix(".tmp").rpartition(".")
            if beside.with_name(name) in paths and number.isdecimal() and not _is_running(int(number)):
                beside.unlink(missing_ok=True)


def _is_running(number: int) -> bool:
    """Return whether there is a process of this number; where that cannot be asked, as if there were."""
    if os.name != "posix":
        return True
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # another user's
        pass
    return True


def half_written(path: Path) -> Path:
    """Return where a file is written before it is renamed."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def unwritable(folder: Path, error: OSError) -> OutputError:
    """Return the one line about a folder that takes no files."""
    reason = error.strerror or type(error).__name__
    room = "make room there or " if error.errno in (errno.ENOSPC, errno.EDQUOT) else ""
    return OutputError(f"{folder}: results cannot be written there ({reason}); {room}name another folder")


def check_file(target: Path, what: str, inputs: Iterable[Path] = (), *, option: str = "-o") -> None:
    """Refuse, before any work, to write one file where it would replace what is not of an earlier call.

    ``what`` it is, as of `KINDS`, and the ``option`` that names it are for the message. OutputError if it is
    one of the ``inputs``, a folder, or a file of another kind.
    """
    if os.path.realpath(target) in {os.path.realpath(path) for path in inputs}:
        raise OutputError(f"{target}: the {what} would replace a photograph; name another with {option}")
    if target.is_dir():
        raise OutputError(f"{target}: is a folder; name the {what} with {option}")
    if os.path.lexists(target) and not is_ours(target, KINDS.get(what)):
        raise OutputError(
            f"{target}: is no {what} of an earlier call; name another with {option} or remove it"
        )


@contextmanager
def writable_folders(*folders: Path | None) -> Iterator[None]:
    """Create folders that can be written, which is tried; at the end remove those in which nothing lies.

    OutputError if one cannot be created or written.
    """
    created: set[Path] = set()
    try:
        for folder in filter(None, folders):
            try:
                created |= {path for path in (folder, *folder.parents) if not path.exists()}
                folder.mkdir(parents=True, exist_ok=True)
                with tempfile.TemporaryFile(dir=folder):  # of a name that no other process uses
                    pass
            except OSError as error:
                raise unwritable(folder, error) from None
        yield
    finally:
        for folder in sorted(created, reverse=True):
            with suppress(OSError):
                folder.rmdir()


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Create a folder, see `writable_folders`, for what is written; OutputError where it cannot be."""
    with writable_folders(folder):
        try:
            yield
        except OSError as error:
            raise unwritable(folder, error) from None


@dataclass(frozen=True, kw_only=True)
class ResultFiles:
    """The files of one photograph, of which the last one, a document, is written last: then all are there."""

    folder: Path
    stem: str  # the photograph's name without its suffix
    endings: tuple[str, ...]  # what follows it, such as ".json", in the order of writing
    beside: Path | None = None  # a file with a name of its own, written first

    @property
    def paths(self) -> tuple[Path, ...]:
        """All of them, in the order of writing."""
        named = tuple(self.folder / f"{self.stem}{ending}" for ending in self.endings)
        return named if self.beside is None else (self.beside, *named)

    @property
    def document(self) -> Path:
        """The JSON document."""
        return self.paths[-1]


def is_ours(path: Path, kind: str | None = None) -> bool:
    """Return whether a file says that blur2view wrote it; pictures of 0.1.0 do not.

    ``kind`` is the suffix that stands for what it should be; its own by default.
    """
    signs = SIGNS.get(kind or path.suffix.lower(), ())
    with suppress(OSError), open_regular(path) as file:
        start = file.read(1 << 20)
        return any(sign in start for sign in signs) or (".json" in path.suffix and _is_cut(start))
    return False


def _is_cut(start: bytes) -> bool:
    """Return whether a file is empty, or a document whose end is missing."""
    if not start.startswith(DOCUMENT):
        return DOCUMENT.startswith(start)
    try:
        parse_json(start)
    except ValueError:
        return True
    return False


def below_shared_folder(paths: Sequence[Path]) -> list[Path]:
    """Return paths below the folder that all files share; one at which there is none changes no other's."""
    absolute = [os.path.abspath(path) for path in paths]
    there = [path for path in absolute if is_there(path)] or absolute
    folder = os.path.commonpath([os.path.dirname(path) for path in there])
    return [Path(os.path.relpath(path, folder)) for path in absolute]


def write_text(target: Path, text: str) -> None:
    """Write a table or a list, whole or not at all."""
    with writing(target.parent):
        write_files({target: text.encode("utf-8", "surrogateescape")})
