"""Files that a user names or that an earlier call left: any of them may be anything, or anybody's."""

import errno
import io
import os
import stat
from contextlib import ExitStack
from importlib.util import find_spec
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

MAX_BYTES = 1 << 30  # 16-bit colour of 105 megapixels, stored as it is, has 0.6 GiB
MAX_PIXELS = 105_000_000  # of a photograph, as medium-format sensors have; an estimate takes 64 bytes of each
# What is read, by Pillow's names. Of the others it calls Ghostscript for one, PostScript, which is a program.
FORMATS = ("JPEG", "PNG", "BMP", "GIF", "PPM", "TIFF", "WEBP", "AVIF", "JPEG2000", "TGA")
BY_EXTRAS = ("HEIF",)  # where pillow-heif has been registered


def open_regular(path: str | os.PathLike[str]) -> io.BufferedReader:
    """Open a regular file for reading; OSError of a pipe, a device or a folder, which may wait for ever.

    So may files of /proc: they say that they are empty, and are not.
    """
    try:
        _require_regular(os.stat(path))
    except ValueError as error:  # a null character in the path
        raise OSError(errno.EINVAL, str(error)) from None
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with ExitStack() as unused:
        file = unused.enter_context(os.fdopen(os.open(path, flags), "rb"))
        size = _require_regular(os.fstat(file.fileno()))  # now of what nobody can exchange any more
        if not size and os.read(file.fileno(), 1):
            raise OSError(errno.EINVAL, "is no regular file")
        unused.pop_all()
    return file


def _require_regular(status: os.stat_result) -> int:
    """Return the size of a regular file; OSError of any other."""
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "is no regular file")
    return status.st_size


def read_regular(path: str | os.PathLike[str], most: int = MAX_BYTES) -> bytes:
    """Return a regular file's content; OSError of any other, or if it has more bytes than allowed."""
    with open_regular(path) as file:
        _allow(os.fstat(file.fileno()).st_size, most)
        return file.read()


def read_stream(stream: BinaryIO, most: int = MAX_BYTES) -> bytes:
    """Return what is left of a stream, which may never end; OSError if that is more bytes than allowed."""
    content = stream.read(most + 1)
    _allow(len(content), most)
    return content


def _allow(size: int, most: int) -> None:
    if size > most:
        raise OSError(errno.EFBIG, f"is larger than {most >> 20} MiB")


def open_picture(content: bytes) -> "ImageFile":
    """Open a photograph's content by Pillow, which raises errors of any type of what is damaged.

    This is the only place that does: of no format that starts another program. UnidentifiedImageError of a
    picture of another format.
    """
    from PIL import Image

    known = [one for one in FORMATS if one != "AVIF" or find_spec("PIL.AvifImagePlugin")]  # Pillow 11.3
    extras = [one for one in BY_EXTRAS if one in Image.OPEN]
    return Image.open(io.BytesIO(content), formats=[*known, *extras])
