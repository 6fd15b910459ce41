"""Files that appear whole or not at all."""

import os
from collections.abc import Container, Iterable, Mapping
from pathlib import Path

from blur2view.errors import OutputError


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


def remove_left_over(paths: Container[Path], folders: Iterable[Path]) -> None:
    """Remove what processes that were killed left beside these files, half written."""
    for folder in folders:
        for beside in folder.glob(".*.*.tmp"):
            name, _, number = beside.name.removeprefix(".").removesuffix(".tmp").rpartition(".")
            if beside.with_name(name) in paths and number.isdecimal() and not _is_running(int(number)):
                beside.unlink(missing_ok=True)


def _is_running(number: int) -> bool:
    """Return whether there is a process of this number; where that cannot be asked, as if there were."""
    if os.name != "posix":
        return True
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # another user's
        pass
    return True


def half_written(path: Path) -> Path:
    """Return where a file is written before it is renamed."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def unwritable(folder: Path, error: OSError) -> OutputError:
    """Return the one line about a folder that takes no files."""
    reason = error.strerror or type(error).__name__
    return OutputError(f"{folder}: results cannot be written there ({reason}); choose another folder with -o")
