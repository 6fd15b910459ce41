"""Files that a user names: read whole, if they are files and of a possible size."""

import errno
from pathlib import Path

MAX_BYTES = 1 << 30  # 16-bit colour of 175 megapixels, stored as it is, has as much
MAX_MEMORY_GIB = 2.0  # what an estimate may take unless the user allows more


def read_regular(path: Path) -> bytes:
    """Return a file's content; OSError of a pipe or a device, which may never end, or of more than 1 GiB.

    What says that it is empty is not read: some files of /proc wait for ever.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise OSError(errno.EINVAL, "is no regular file")
        size = path.stat().st_size if path.is_file() else -1
        if size > MAX_BYTES:
            raise OSError(errno.EFBIG, f"is larger than {MAX_BYTES >> 30} GiB")
        return path.read_bytes() if size else b""
    except ValueError as error:  # a null character in the path
        raise OSError(errno.EINVAL, str(error)) from None
