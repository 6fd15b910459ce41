"""Files that a user names, which may hold anything, never end, or be a picture of any kind."""

import errno
import hashlib
import io
import os
import stat
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

MAX_BYTES = 1 << 30  # bound; 16-bit colour of 105 megapixels, stored as it is, has 0.6 GiB
MAX_PIXELS = 105_000_000  # of a photograph, as medium-format sensors have; an estimate takes 64 bytes of each
FORMATS = ("JPEG", "PNG", "BMP", "GIF", "PPM", "TIFF", "WEBP", "AVIF", "JPEG2000", "TGA")
"""What is read, by Pillow's names. Of the others PostScript would start a program, Ghostscript."""
FORMATS_BY_EXTRAS = ("HEIF",)  # where pillow-heif has been registered
READ_WHOLE, READ_PART = 4 << 30, 256 << 20  # bytes: of a larger file's start and end `quick_digest` is made


def open_regular(path: str | os.PathLike[str]) -> io.BufferedReader:
    """Open a regular file for reading.

    Raises OSError for a folder, and for a pipe or a device, which may never end; so may files of /proc, which
    state a length of 0 and are not empty.
    """
    try:
        status = os.stat(path)
    except ValueError as error:  # a null character in the path
        raise OSError(errno.EINVAL, str(error)) from None
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if stat.S_ISREG(status.st_mode) and (status.st_size or _ends_at_once(path)):
        return open(path, "rb")
    raise OSError(errno.EINVAL, "is not a regular file")


def _ends_at_once(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is empty; a reader of /proc/kmsg would wait until the kernel says something."""
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    try:
        return not os.read(descriptor, 1)
    except BlockingIOError:
        return False
    finally:
        os.close(descriptor)


def read_regular(path: str | os.PathLike[str], limit: int = MAX_BYTES) -> bytes:
    """Return a regular file's content; OSError if it is not one, or if it has more bytes than ``limit``."""
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

    formats = [name for name in FORMATS if name != "AVIF" or find_spec("PIL.AvifImagePlugin")]  # Pillow 11.3
    extras = [name for name in FORMATS_BY_EXTRAS if name in Image.OPEN]
    file = io.BytesIO(content) if isinstance(content, bytes) else content
    try:
        return Image.open(file, formats=[*formats, *extras])
    except ValueError as error:
        if "MAX_TEXT" not in str(error):
            raise
        file.seek(0)
        return Image.open(io.BytesIO(_without_texts(file.read())), formats=["PNG"])


def _without_texts(png: bytes) -> bytes:
    """Return a PNG without its text chunks, the longest of which Pillow refuses."""
    parts, start = [png[:8]], 8
    while start < len(png):
        end = start + 12 + int.from_bytes(png[start : start + 4])
        if png[start + 4 : start + 8] not in (b"tEXt", b"zTXt", b"iTXt"):
            parts.append(png[start:end])
        start = end
    return b"".join(parts)


def quick_digest(path: Path) -> str:
    """Return the SHA-256 of a regular file, of one that takes long to read of its size, start and end."""
    size = path.stat().st_size
    if size <= READ_WHOLE:
        return file_digest(path)
    digest = hashlib.sha256(b"%d" % size)
    with open_regular(path) as file:
        for at in (0, size - READ_PART):
            file.seek(at)
            digest.update(file.read(READ_PART))
    return digest.hexdigest()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a regular file, in hexadecimal digits; OSError of any other."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
