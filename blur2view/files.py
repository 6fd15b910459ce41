"""Files that a user names, which may be anything or anybody's, and files that are written."""

import errno
import hashlib
import io
import os
import stat
import tempfile
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from blur2view.errors import OutputError

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

MAX_BYTES = 1 << 30  # bound; 16-bit colour of 105 megapixels, stored as it is, has 0.6 GiB
MAX_PIXELS = 105_000_000  # of a photograph, as medium-format sensors have; an estimate takes 64 bytes of each
FORMATS = ("JPEG", "PNG", "BMP", "GIF", "PPM", "TIFF", "WEBP", "AVIF", "JPEG2000", "TGA")
"""What is read, by Pillow's names. Of the others PostScript would start a program, Ghostscript."""
FORMATS_BY_EXTRAS = ("HEIF",)  # where pillow-heif has been registered
SIGNED_BY = "blur2view"  # the PNG text "Software"
SIGNATURES = (
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
SIGNATURE_BYTES = 1 << 20  # bound; bytes at the start of a file that are searched for a signature


def open_regular(path: str | os.PathLike[str]) -> io.BufferedReader:
    """Open a regular file for reading; OSError of a folder, and of a pipe or device, which may never end.

    So may files of /proc, which say that they are empty, and are not.
    """
    try:
        status = os.stat(path)
    except ValueError as error:  # a null character in the path
        raise OSError(errno.EINVAL, str(error)) from None
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if stat.S_ISREG(status.st_mode):
        file = open(path, "rb")  # noqa: SIM115  who called closes it
        if status.st_size or not file.read(1):
            return file
        file.close()
    raise OSError(errno.EINVAL, "is no regular file")


def read_regular(path: str | os.PathLike[str], limit: int = MAX_BYTES) -> bytes:
    """Return a regular file's content; OSError of any other, or of one that has more bytes than ``limit``."""
    with open_regular(path) as file:
        return read_stream(file, limit)


def read_stream(stream: BinaryIO, limit: int = MAX_BYTES) -> bytes:
    """Return the rest of a stream, which may never end; OSError if it has more bytes than ``limit``."""
    content = stream.read(limit + 1)
    if len(content) > limit:
        raise OSError(errno.EFBIG, f"is larger than {limit >> 20} MiB")
    return content


def open_picture(content: bytes | BinaryIO) -> "ImageFile":
    """Open a photograph's content or file by Pillow, whose errors of damaged content have any type.

    Nothing else opens photographs: formats that start a program are left out. UnidentifiedImageError of a
    picture of another format.
    """
    from PIL import Image

    known = [name for name in FORMATS if name != "AVIF" or find_spec("PIL.AvifImagePlugin")]  # Pillow 11.3
    extras = [name for name in FORMATS_BY_EXTRAS if name in Image.OPEN]
    file = io.BytesIO(content) if isinstance(content, bytes) else content
    return Image.open(file, formats=[*known, *extras])


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a regular file, in hexadecimal digits; OSError of any other."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def real_paths(paths: Iterable[Path]) -> set[str]:
    """Return the paths without links."""
    return {os.path.realpath(path) for path in paths}


def check_file(target: Path, inputs: Collection[str] = (), *, option: str = "-o") -> None:
    """Refuse, before any work, to write a file that would replace what blur2view did not write.

    OutputError, which proposes the ``option``, if it is one of the ``inputs`` (real paths), no regular file,
    or has no signature.
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
    """Return whether a file is signed by blur2view; a list of names has no room for a signature."""
    with suppress(OSError), open_regular(path) as file:
        start = file.read(SIGNATURE_BYTES)
        return any(signature in start for signature in SIGNATURES)
    return False


def writable_folder(folder: Path) -> Path:
    """Return a folder, or the nearest one above it that is there, after trying to write in it.

    OutputError if nothing can be written there.
    """
    there = next(above for above in (folder, *folder.absolute().parents) if os.path.lexists(above))
    try:
        with tempfile.TemporaryFile(dir=there):  # of a name that no other process uses
            return there
    except OSError as error:
        raise unwritable(folder, error) from None


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write files beside their paths, wait until the disk has them, then rename them; OSError if it fails.

    A reader never sees half a file, and the old files stay if a new one cannot be written. The last file
    marks that all are complete: an old one is removed before the first rename. Folders are created. A link
    stays: the file that it leads to is written, in a folder that exists.
    """
    places = {Path(os.path.realpath(path)): content for path, content in files.items()}
    try:
        for path in files:
            path.parent.mkdir(parents=True, exist_ok=True)
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
            with suppress(OSError):
                half_written(path).unlink()


def half_written(path: Path) -> Path:
    """Return where a file is written before it is renamed; a killed call's is overwritten by the next."""
    name = hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]  # a long name with an ending is too long
    return path.with_name(f".{name}.{SIGNED_BY}.tmp")


def write_file(target: Path, content: bytes) -> None:
    """Write one file as `write_files` does; OutputError where it cannot be written."""
    write_beside({target: content})


def write_beside(files: Mapping[Path, bytes]) -> None:
    """Write files as `write_files` does; OutputError, which names the last one's folder, if it fails."""
    try:
        write_files(files)
    except OSError as error:
        raise unwritable(list(files)[-1].parent, error) from error


def unwritable(folder: Path, error: OSError) -> OutputError:
    """Return the error of a folder in which a file cannot be written."""
    folder = folder if folder.name else Path(os.path.abspath(folder))  # . says little
    if isinstance(error, FileExistsError | NotADirectoryError):
        return OutputError(f"{folder}: is no folder, as results need one; name another")
    reason = error.strerror or type(error).__name__
    return OutputError(
        f"{folder}: results cannot be written there ({reason}); make room, or name another folder"
    )
