"""Every file that is written: whole or not at all, and in place of nothing but what blur2view wrote itself.

What blur2view writes carries a signature that no other program writes. Lists of names have no room for one:
none that is there is replaced.
"""

import errno
import hashlib
import os
import stat
import tempfile
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from zipfile import ZipFile

from blur2view.errors import OutputError
from blur2view.input_files import open_picture, open_regular, read_regular

SIGNED_BY = "blur2view"  # the PNG text "Software"
SIGNS = {
    ".json": (b'"options_sha256": "', b'"generator": "blur2view '),
    ".npz": (b"smear_grid.npy",),
    ".png": (b"Software\0" + SIGNED_BY.encode(),),
    ".html": (b'name="generator" content="blur2view ',),
    ".ply": (f"comment {SIGNED_BY}\n".encode(),),
    ".gcsv": (f"id,{SIGNED_BY}\n".encode(),),
    ".csv": (b"name,error,use,verdict,blur,",),
}
"""What files hold, by suffix: keys, the first array of NPZ, the text of PNG, a tag, a comment, columns."""
KINDS = {"page": ".html", "file": ".json", "point cloud": ".ply", "log": ".gcsv", "table": ".csv"}
"""Suffixes of files that may be called anything, by what they are."""
HALF_WRITTEN = f".{SIGNED_BY}.tmp"  # ending of what is not yet renamed
SIGN_BYTES = 1 << 20  # of a file, in which its signature stands


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write files beside their paths, wait until the disk has them, then rename them; OSError if it fails.

    A reader never sees half a file. The last of several marks that all are complete: an old one is removed
    before the first rename. If a file cannot be written the old ones stay. A link stays one: what it leads to
    is written. What is no regular file, as a device, is not replaced.
    """
    places = {_place(path): content for path, content in files.items()}
    try:
        for path, content in places.items():
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


def _place(path: Path) -> Path:
    """Return where a path leads; OSError if that is no regular file."""
    if path.is_symlink():
        path = Path(os.path.realpath(path))
    with suppress(FileNotFoundError):
        if not stat.S_ISREG(path.stat().st_mode):
            raise OSError(errno.EINVAL, "it is no regular file")
    return path


def half_written(path: Path) -> Path:
    """Return where this process writes a file before it is renamed: a name that is long enough for none."""
    name = hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]
    return path.with_name(f".{name}.{os.getpid()}{HALF_WRITTEN}")


def remove_half_written(folder: Path) -> None:
    """Remove the files of a folder that processes which do not run any more left half written."""
    for path in folder.glob(f".*{HALF_WRITTEN}"):
        number = path.name.removesuffix(HALF_WRITTEN).rpartition(".")[2]
        try:
            os.kill(int(number), 0)
        except ProcessLookupError:
            path.unlink(missing_ok=True)
        except (ValueError, OverflowError, OSError):  # no process of this program
            continue


def write_file(target: Path, content: bytes) -> None:
    """Write one file, whole or not at all, in a folder that is created; OutputError where it cannot be."""
    write_beside({target: content})


def write_beside(files: Mapping[Path, bytes]) -> None:
    """Write the files of one folder, all or none of them, as `write_file` does."""
    folder = next(iter(files)).parent
    with _created(folder):
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
    room = "make room there or " if error.errno in (errno.ENOSPC, errno.EDQUOT) else ""
    return OutputError(f"{folder}: results cannot be written there ({reason}); {room}name another folder")


@contextmanager
def writable_folders(*folders: Path | None) -> Iterator[None]:
    """Create folders that can be written, which is tried; at the end remove those in which nothing lies.

    What killed calls left half written there is removed. OutputError if one cannot be created or written.
    """
    with _created(*folders):
        for folder in filter(None, folders):
            remove_half_written(folder)
        yield


@contextmanager
def _created(*folders: Path | None) -> Iterator[None]:
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


def check_file(target: Path, what: str, inputs: Container[str] = (), *, option: str = "-o") -> None:
    """Refuse, before any work, to write a file where it would replace what blur2view did not write.

    ``what`` it is, as of `KINDS`, and the ``option`` that names it are for the message. OutputError if it is
    one of the ``inputs``, real paths, no regular file, a link to nowhere, or has no signature.
    """
    remedy = f"name another with {option}"
    real = Path(os.path.realpath(target))
    if str(real) in inputs:
        raise OutputError(f"{target}: the {what} would replace an input of this call; {remedy}")
    if target.is_dir():
        raise OutputError(f"{target}: is a folder, where the {what} is to be; {remedy}")
    if target.is_symlink() and not real.parent.is_dir():
        raise OutputError(f"{target}: is a link into a folder that is not there, {real.parent}; {remedy}")
    if target.exists() and not real.is_file():
        raise OutputError(f"{target}: is no regular file; {remedy}")
    if target.exists() and not is_ours(target, KINDS.get(what)):
        why = f"is no {what} of an earlier call" if what != "list" else "is there; no list is replaced"
        raise OutputError(f"{target}: {why}; move it away, or {remedy}")


def is_ours(path: Path, kind: str | None = None) -> bool:
    """Return whether a file says that blur2view wrote it.

    ``kind`` is the suffix that stands for what it should be; its own by default.
    """
    signs = SIGNS.get(kind or path.suffix.lower(), ())
    with suppress(OSError), open_regular(path) as file:
        start = file.read(SIGN_BYTES)
        return any(sign in start for sign in signs)
    return False


def is_whole(path: Path) -> bool:
    """Return whether a file is there, of a PNG or NPZ with the checksums of all its parts."""
    try:
        if path.suffix == ".png":
            open_picture(read_regular(path)).verify()
        elif path.suffix == ".npz":
            return ZipFile(path).testzip() is None
        return path.is_file()
    except Exception:  # of any type, of what is damaged
        return False


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a regular file, in hexadecimal digits; OSError of any other."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def real_paths(paths: Iterable[Path]) -> set[str]:
    """Return where paths lead; a name with a null character leads nowhere."""
    return {os.path.realpath(path) for path in paths if "\0" not in str(path)}
