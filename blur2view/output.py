"""Files that are written: whole or not at all, and never in place of what blur2view did not write."""

import errno
import hashlib
import os
import platform
import shutil
import tempfile
import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from blur2view.errors import OutputError
from blur2view.files import file_digest, open_regular, read_regular

SIGNED_BY = "blur2view"
"""What signs a file; those who write PNG, HTML, PLY and Gyroflow's log put it where `SIGNATURES` says."""
RECORD_KEY, GRID_KEY, KERNELS_KEY = "options_sha256", "smear_grid", "blur_kernels"
"""Keys of a photograph's JSON and of two NPZ, by which they are known without a signature."""
SIGNATURES = tuple(
    text.encode()
    for text in (
        f'"{RECORD_KEY}": "',
        f'"generator": "{SIGNED_BY} ',
        f"{GRID_KEY}.npy",
        f"{KERNELS_KEY}.npy",
        f"Software\0{SIGNED_BY}",
        f'name="generator" content="{SIGNED_BY} ',
        f"comment {SIGNED_BY}\n",
        f"id,{SIGNED_BY}\n",
    )
)
"""What files hold that blur2view wrote: JSON (a record; `signed`), NPZ (two), PNG, HTML, PLY, Gyroflow."""
NOTES = ".blur2view.sha256"  # of a folder: digests of what was written there and has no signature
HALF = ".blur2view.tmp"  # how names of half-written files end
LOCK_S, PAUSE_S = 10.0, 0.02  # bound of waiting for another call that writes in a folder, and between looks
NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
SIGNATURE_BYTES = 1 << 20  # bound; bytes at the start of a file that are searched for a signature


def real_paths(paths: Iterable[Path]) -> set[str]:
    """Return the paths without links."""
    return {os.path.realpath(path) for path in paths}


def check_file(target: Path, inputs: Collection[str] = (), *, option: str = "-o") -> None:
    """Refuse, before any work, to write a file that would replace what blur2view did not write.

    OutputError, which proposes the ``option``, if it is one of the ``inputs`` (real paths), not a regular
    file, differs from what was noted (`note`), was not noted and has no signature, or has an impossible name.
    """
    remedy = f"name another with {option}"
    if error := impossible(target):
        raise OutputError(f"{target}: cannot be written ({error.strerror}); {remedy}")
    if target.is_dir():
        raise OutputError(f"{target}: is a folder; name a file with {option}")
    if (real := os.path.realpath(target)) in inputs:
        raise OutputError(f"{target}: would replace an input of this call; {remedy}")
    if os.path.lexists(real) and not os.path.isfile(real):  # or it is a link to itself
        raise OutputError(f"{target}: is not a regular file; {remedy}")
    if not target.exists() or (same := is_noted(target)):
        return
    if same is False:
        raise OutputError(f"{target}: has changed since blur2view wrote it; move it away, or {remedy}")
    if not is_ours(target):
        raise OutputError(
            f"{target}: already exists and was not written by blur2view; move it away, or {remedy}"
        )


def impossible(path: Path) -> OSError | None:
    """Return why the system has no such path, as one with too long a name; None if one may be made there."""
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        return error
    return None


def note(digests: Mapping[Path, str]) -> None:
    """Note the SHA-256 of files before they are written, so that `is_noted` knows what a user changed since.

    It is for what has no room for a signature, and for what users edit: call it while the folder is `locked`,
    or let ``write_file(..., noted=True)`` do so. The notes of a folder are its `NOTES`, a line for each file
    as sha256sum prints it. What was noted of a file that is still there stays beside the new digest, as the
    call may be killed before it writes. OSError if they cannot be written.
    """
    folders = {Path(os.path.realpath(path)).parent for path in digests}
    for folder in sorted(folders):
        lines = {name: sorted(earlier) for name, earlier in _notes(folder).items()}
        for path, digest in digests.items():
            real = Path(os.path.realpath(path))
            if real.parent == folder:
                current_digest = [file_digest(real)] if is_noted(real) else []
                lines[real.name] = list(dict.fromkeys([*current_digest, digest]))
        rows = [f"{digest}  {_ascii(name)}\n" for name in sorted(lines) for digest in lines[name]]
        _replace({folder / NOTES: "".join(rows).encode()})


def is_noted(path: Path) -> bool | None:
    """Return whether a file is as blur2view noted it; None if nothing was noted of it, or it is gone."""
    real = Path(os.path.realpath(path))
    digests = _notes(real.parent).get(real.name)
    return None if digests is None or not real.exists() else file_digest(real) in digests


def _notes(folder: Path) -> dict[str, set[str]]:
    """Return the digests that are noted of files in a folder, by their names."""
    notes = dict[str, set[str]]()
    with suppress(OSError):
        for row in read_regular(folder / NOTES).decode("ascii", "replace").splitlines():
            digest, _, name = row.partition("  ")
            with suppress(UnicodeDecodeError):
                notes.setdefault(name.encode().decode("unicode_escape"), set()).add(digest)
    return notes


def _ascii(name: str) -> str:
    """Return a file's name with escapes for all that is not ASCII."""
    return name.encode("unicode_escape").decode()


def is_ours(path: Path) -> bool:
    """Return whether a file is signed by blur2view; tables and lists of names are not, but noted."""
    with suppress(OSError), open_regular(path) as file:
        start = file.read(SIGNATURE_BYTES)
        return any(signature in start for signature in SIGNATURES)
    return False


def signed(content: Mapping[str, Any], writer: str) -> dict[str, Any]:
    """Return the content of a JSON file with its signature first; ``writer`` is a version or a command."""
    return {"generator": f"{SIGNED_BY} {writer}", **content}


def writable_folder(folder: Path) -> Path:
    """Return a folder, or the nearest one above it that is there, after trying to write in it.

    What killed calls left half written in the folder is removed. OutputError if nothing can be written there.
    """
    if error := impossible(folder):
        raise unwritable(folder, error)
    nearest = next(above for above in (folder, *folder.absolute().parents) if os.path.lexists(above))
    try:
        with tempfile.TemporaryFile(dir=nearest):  # of a name that no other process uses
            pass
    except OSError as error:
        raise unwritable(folder, error) from None
    for path in folder.glob(f".*.{_host()}-*{HALF}"):
        number = path.name.removesuffix(HALF).rpartition("-")[2]
        if not _runs(int(number) if number.isdecimal() else 0):
            with suppress(OSError):
                shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
    return nearest


def write_files(files: Mapping[Path, bytes], *, noted: bool = False) -> None:
    """Write files beside their paths, wait until the disk has them, then rename them; OSError if it fails.

    A reader never sees half a file, and the old files stay if a new one cannot be written. The last file
    comes last; others of the same call are not yet there, or older, if it does not match them. Another call
    that writes in its folder waits. Folders are created. A link stays: the file that it leads to is written,
    in a folder that exists. What is ``noted`` is refused once it has changed (`check_file`).
    """
    for path in files:
        path.parent.mkdir(parents=True, exist_ok=True)
    with locked(Path(os.path.realpath(list(files)[-1])).parent):
        if noted:
            note({path: hashlib.sha256(content).hexdigest() for path, content in files.items()})
        _replace({Path(os.path.realpath(path)): content for path, content in files.items()})


def _replace(files: Mapping[Path, bytes]) -> None:
    """Write files beside their paths, wait until the disk has them, then rename them."""
    try:
        for path, content in files.items():
            with open(half_written(path), "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        for path in files:
            half_written(path).replace(path)
    finally:
        for path in files:
            with suppress(OSError):
                half_written(path).unlink()


@contextmanager
def locked(folder: Path, *, alone: bool = False) -> Iterator[None]:
    """Keep other calls of blur2view from writing in a folder until the block ends.

    The system ends the lock of a killed call. One that takes too long, or a system without such locks, is not
    waited for: then the later of two writers wins, file by file. A call that works there ``alone``, and
    writes files as others do, does not begin: OutputError if another one is there.
    """
    if (real := os.path.realpath(folder)) in _ALONE_IN and not alone:
        yield
        return
    descriptor, is_taken = None, False
    with suppress(ImportError, OSError):
        import fcntl

        descriptor = os.open(folder, os.O_RDONLY)
        for _ in range(round((PAUSE_S if alone else LOCK_S) / PAUSE_S)):
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                is_taken = False
                break
            except BlockingIOError:
                is_taken = True
                time.sleep(PAUSE_S)
    try:
        if alone and is_taken:
            raise OutputError(f"{folder}: another call writes there; let it end, or name another folder")
        _ALONE_IN.update([real] if alone else [])
        yield
    finally:
        if alone and not is_taken:
            _ALONE_IN.discard(real)
        if descriptor is not None:
            os.close(descriptor)


_ALONE_IN = set[str]()  # folders in which this process works alone


def half_written(path: Path) -> Path:
    """Return where this process writes a file before a rename; `writable_folder` removes what is left."""
    name = hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]  # a long name with an ending is too long
    return path.with_name(f".{name}.{_host()}-{os.getpid()}{HALF}")


def _host() -> str:
    """Return a name of this machine: processes of others have numbers of their own."""
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def _runs(process: int) -> bool:
    """Return whether a process of this machine runs, as far as one can know."""
    if process <= 0 or os.name == "nt":  # where a signal of 0 would end it
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True


def write_file(target: Path, content: bytes, *, noted: bool = False) -> None:
    """Write one file as `write_files` does; OutputError where it cannot be written."""
    write_beside({target: content}, noted=noted)


def write_beside(files: Mapping[Path, bytes], *, noted: bool = False) -> None:
    """Write files as `write_files` does; OutputError, which names the last one's folder, if it fails."""
    try:
        write_files(files, noted=noted)
    except OSError as error:
        raise unwritable(list(files)[-1].parent, error) from error


def checked_line(text: str) -> str:
    """Return a line that `checked_lines` knows to be whole."""
    return f"{hashlib.sha256(text.encode()).hexdigest()[:16]} {text}\n"


def checked_lines(path: Path) -> list[str]:
    """Return the texts of a file's lines but those that were cut or changed; none of no file."""
    with suppress(OSError):
        lines = read_regular(path).decode("utf-8", "replace").splitlines(keepends=True)
        texts = [(line, line.partition(" ")[2].removesuffix("\n")) for line in lines]
        return [text for line, text in texts if checked_line(text) == line]
    return []


def add_checked_line(path: Path, text: str) -> None:
    """Add a line to a file, which is whole or left out by `checked_lines`; OutputError if that fails."""
    try:
        with open(path, "a", encoding="utf-8") as file:
            file.write(checked_line(text))
    except OSError as error:
        raise unwritable(path.parent, error) from error


def unwritable(folder: Path, error: OSError) -> OutputError:
    """Return the error of a folder in which a file cannot be written."""
    folder = folder if folder.name else Path(os.path.abspath(folder))  # . says little
    if isinstance(error, FileExistsError | NotADirectoryError):
        return OutputError(f"{folder}: is not a folder; choose another output folder")
    remedy = "free some space, or name another folder" if error.errno in NO_ROOM else "name another folder"
    reason = error.strerror or type(error).__name__
    return OutputError(f"{folder}: results cannot be written there ({reason}); {remedy}")
