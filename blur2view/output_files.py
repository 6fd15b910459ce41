"""Files of results: planned before any work, each written whole or not at all."""

import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from blur2view.errors import OutputError
from blur2view.file_writing import is_there, unwritable, write_files
from blur2view.input_files import open_regular

SIGNED_BY = "blur2view"  # the PNG text "Software"
# What results hold: a key of JSON documents, the first array of an NPZ file, PNG's text, the report's tag,
# the head of a table
SIGNS = {
    ".json": (b'"model_id":', b'"generator": "blur2view '),
    ".npz": (b"smear_grid.npy", b"displacement.npy"),
    ".png": (b"Software\0" + SIGNED_BY.encode(),),
    ".html": (b'name="generator" content="blur2view ',),
    ".ply": (f"comment {SIGNED_BY}\n".encode(),),
    ".csv": (b"name,verdict,parallax,smear_px,",),
}
# of one file, whatever it is called
KINDS = {"page": ".html", "table": ".csv", "file": ".json", "point cloud": ".ply"}


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
def prepared(*folders: Path | None) -> Iterator[None]:
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
    """Create a folder, see `prepared`, for what is written; OutputError where it cannot be."""
    with prepared(folder):
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
        return any(sign in start for sign in signs)
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
