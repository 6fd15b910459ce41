"""The errors a user may meet; each message is one line that names the path and the remedy."""

import math
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


def address_space_mib() -> float:
    """Return how much address space this process may have, MiB; infinite where the system has no limit."""
    try:
        import resource
    except ImportError:
        return math.inf
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return math.inf if limit == resource.RLIM_INFINITY else limit / 2**20


def system_error(error: Exception, *, jobs: bool = False) -> Blur2ViewError:
    """Return the error that too little memory, or a library that is not whole, caused; any other is raised.

    ``jobs`` says that the command has the option --jobs.
    """
    reason = " ".join(str(error).split())
    unloaded = isinstance(error, ImportError) or "Cannot import" in reason  # of pycolmap
    if not (unloaded or isinstance(error, MemoryError) or "start new thread" in reason):
        raise error
    limit = address_space_mib()
    limited = f"allow a larger address space than {limit:.0f} MiB with ulimit -v"
    if unloaded:
        remedy = "free memory" if math.isinf(limit) else limited
        return Blur2ViewError(f"a library cannot be loaded ({reason}); {remedy}, or install it again")
    remedy = "free some, or add --jobs 1 if there are many photographs" if jobs else "free some"
    return Blur2ViewError(f"too little memory; {remedy if math.isinf(limit) else limited}")
