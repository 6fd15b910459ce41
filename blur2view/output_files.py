"""Files of results: planned before any work, each written whole or not at all."""

import errno
import os
import tempfile
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from blur2view.errors import OutputError
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
    ".csv": (b"name,verdict,parallax,",),
}
HALF_WRITTEN = f".{SIGNED_BY}.tmp"  # ending of what is not yet renamed
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


def half_written(path: Path) -> Path:
    """Return where this process writes a file before it is renamed."""
    return path.with_name(f".{path.name}.{os.getpid()}{HALF_WRITTEN}")


def remove_half_written(folder: Path) -> None:
    """Remove the files of a folder that processes which do not run any more left half written."""
    for path in folder.glob(f".*{HALF_WRITTEN}"):
        number = path.name.removesuffix(HALF_WRITTEN).rpartition(".")[2]
        try:
            os.kill(int(number), 0)
        except ProcessLookupError:
            path.unlink(missing_ok=True)
        except (ValueError, OverflowError, OSError):  # no process of ours
            continue


def unwritable(folder: Path, error: OSError) -> OutputError:
    """Return the one line about a folder that takes no files."""
    reason = error.strerror or type(error).__name__
    room = "make room there or " if error.errno in (errno.ENOSPC, errno.EDQUOT) else ""
    return OutputError(f"{folder}: results cannot be written there ({reason}); {room}name another folder")


def check_file(target: Path, what: str, inputs: Container[str] = (), *, option: str = "-o") -> None:
    """Refuse, before any work, to write a file where it would replace what is not of an earlier call.

    ``what`` it is, as of `KINDS`, and the ``option`` that names it are for the message. OutputError if it is
    one of the ``inputs``, real paths, a folder, or a file of another kind.
    """
    remedy = f"name another with {option}"
    if os.path.realpath(target) in inputs:
        raise OutputError(f"{target}: the {what} would replace a photograph; {remedy}")
    if target.is_dir():
        raise OutputError(f"{target}: is a folder, where the {what} is to be; {remedy}")
    if os.path.lexists(target) and not is_ours(target, KINDS.get(what)):
        raise OutputError(f"{target}: is no {what} of an earlier call; {remedy} or remove it")


@contextmanager
def writable_folders(*folders: Path | None) -> Iterator[None]:
    """Create folders that can be written, which is tried; at the end remove those in which nothing lies.

    What killed calls left half written there is removed. OutputError if one cannot be created or written.
    """
    with _writable_folders(*folders):
        for folder in filter(None, folders):
            remove_half_written(folder)
        yield


@contextmanager
def _writable_folders(*folders: Path | None) -> Iterator[None]:
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


def write_file(target: Path, content: bytes) -> None:
    """Write one file, whole or not at all, in a folder that is created; OutputError where it cannot be."""
    write_beside({target: content})


def write_beside(files: Mapping[Path, bytes]) -> None:
    """Write the files of one folder, all or none of them, as `write_file` does."""
    folder = next(iter(files)).parent
    with _writable_folders(folder):
        try:
            write_files(files)
        except OSError as error:
            raise unwritable(folder, error) from None


def is_ours(path: Path, kind: str | None = None) -> bool:
    """Return whether a file says that blur2view wrote it, or is a document that a power cut left empty.

    ``kind`` is the suffix that stands for what it should be; its own by default.
    """
    signs = SIGNS.get(kind or path.suffix.lower(), ())
    with suppress(OSError), open_regular(path) as file:
        start = file.read(1 << 20)
        return any(sign in start for sign in signs) or (path.suffix == ".json" and not start)
    return False


def real_paths(paths: Iterable[Path]) -> set[str]:
    """Return where paths lead; a name with a null character leads nowhere."""
    return {os.path.realpath(path) for path in paths if "\0" not in str(path)}


def below_shared_folder(paths: Sequence[Path]) -> list[Path]:
    """Return paths below the folder that all files share; one at which there is none changes no other's."""
    absolute = [os.path.abspath(path) for path in paths]
    there = [path for path in absolute if is_there(path)] or absolute
    folder = os.path.commonpath([os.path.dirname(path) for path in there])
    return [Path(os.path.relpath(path, folder)) for path in absolute]
