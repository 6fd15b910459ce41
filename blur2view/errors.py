"""The errors a user may meet; each message is one line that names the path and the remedy."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

OPENCV_NO_MEMORY = -4  # cv::Error::StsNoMem


class Blur2ViewError(Exception):
    """An error that the user can mend; its message says in one line what is wrong, where, and the remedy."""


class ImageError(Blur2ViewError):
    """An image file cannot be used."""


class ModelError(Blur2ViewError):
    """A network file cannot be used."""


class OutputError(Blur2ViewError):
    """A result cannot be written, or read again."""


class RunError(Blur2ViewError):
    """A run over many photographs cannot go on."""


class CameraError(Blur2ViewError):
    """A camera's intrinsics cannot be used."""


class DatabaseError(Blur2ViewError):
    """A COLMAP database or model cannot be read or written."""


@contextmanager
def within_memory(path: Path) -> Iterator[None]:
    """Raise an error of any type that reports too little memory as an ImageError of one line."""
    try:
        yield
    except Exception as error:
        if isinstance(error, MemoryError) or getattr(error, "code", None) == OPENCV_NO_MEMORY:
            raise ImageError(f"{path}: does not fit in memory; resize it") from None
        raise
