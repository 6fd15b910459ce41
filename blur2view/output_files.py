"""Every file that is written: whole or not at all, and in place of nothing but what blur2view wrote."""

import errno
import hashlib
import os
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from blur2view.errors import OutputError
from blur2view.input_files import open_regular

SIGNED_BY = "blur2view"  # the PNG text "Software"
SIGNS = (
    b'"options_sha256": "',
    b'"generator": "blur2view ',
    b"smear_grid.npy",
    b"Software\0" + SIGNED_BY.encode(),
    b'name="generator" content="blur2view ',
    f"comment {SIGNED_BY}\n".encode(),
    f"id,{SIGNED_BY}\n".encode(),
    b"name,error,use,verdict,blur,",
)
"""What files hold that blur2view wrote: JSON (two), NPZ, PNG, HTML, PLY, Gyroflow's log, tables."""
SIGN_BYTES = 1 << 20  # of a file, in which its signature stands


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write files beside their paths, wait until the disk has them, then rename them; OSError if it fails.

    A reader never sees half a file. The last of several marks that all are complete: an old one is removed
    before the first rename. If a file cannot be written the old ones stay. A link stays one: what it leads to
    is written. What is no regular file, as a device, is not replaced.
    """
    places = {Path(os.path.realpath(path)): content for path, content in files.items()}
    try:
        for path, content in places.items():
            if path.exists() and not path.is_file():
                raise OSError(errno.EINVAL, "it is no regular file")
            with open(half_written(path), "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        if len(places) > 1:
            list(places)[-1].unlink(missing_ok=True)
        for path in places:
            half_written(path).replace(path)
    finally:
        for path in places:
            half_written(path).unlink(missing_ok=True)


def half_written(path: Path) -> Path:
    """Return where a file is written before it is renamed; what a killed call left there is overwritten."""
    name = hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]  # a long name with an ending is too long
    return path.with_name(f".{name}.{SIGNED_BY}.tmp")


def write_file(target: Path, content: bytes) -> None:
    """Write one file, whole or not at all, in a folder that is created; OutputError where it cannot be."""
    write_beside({target: content})


def write_beside(files: Mapping[Path, bytes]) -> None:
    """Write the files of one folder, all or none of them, as `write_file` does."""
    folder = next(iter(files)).parent
    with writable_folders(folder):
        try:
            write_files(files)
        except OSError as error:
            raise unwritable(folder, error) from None


def unwritable(folder: Path, error: OSError) -> OutputError:
    """Return the one line about a folder that takes no files."""
    folder = folder if folder.name else Path(os.path.abspath(folder))  # . says little
    if isinstance(error, FileExistsError | NotADirectoryError):
        return OutputError(f"{folder}: is no folder, as results need one; name another")
    reason = error.strerror or type(error).__name__
    return OutputError(
        f"{folder}: results cannot be written there ({reason}); make room, or name another folder"
    )


@contextmanager
def writable_folders(*folders: Path) -> Iterator[None]:
    """Create folders that can be written, which is tried; at the end remove those in which nothing lies.

    OutputError if one cannot be created or written.
    """
    created: set[Path] = set()
    try:
        for folder in folders:
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


def check_file(target: Path, inputs: Collection[str] = (), *, option: str = "-o") -> None:
    """Refuse, before any work, to write a file where it would replace what blur2view did not write.

    OutputError, with the ``option`` that names it, if it is one of the ``inputs``, real paths, no regular
    file, or has no signature.
    """
    remedy = f"name another with {option}"
    if (real := os.path.realpath(target)) in inputs:
        raise OutputError(f"{target}: would replace an input of this call; {remedy}")
    if os.path.lexists(real) and not os.path.isfile(real):  # or it is a link to itself
        raise OutputError(f"{target}: is no regular file; {remedy}")
    if target.exists() and not is_ours(target):
        unsigned = "is there and does not say that blur2view wrote it"
        raise OutputError(f"{target}: {unsigned}; move it away, or {remedy}")


def is_ours(path: Path) -> bool:
    """Return whether a file says that blur2view wrote it; lists of names have no room for that."""
    with suppress(OSError), open_regular(path) as file:
        start = file.read(SIGN_BYTES)
        return any(sign in start for sign in SIGNS)
    return False


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a regular file, in hexadecimal digits; OSError of any other."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def real_paths(paths: Iterable[Path]) -> set[str]:
    """Return where paths lead; a name with a null character leads nowhere."""
    return {os.path.realpath(path) for path in paths if "\0" not in str(path)}
