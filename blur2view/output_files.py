"""Files of results: planned before any work, each written whole or not at all."""

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Protocol, TypeVar

from blur2view.errors import OutputError

Write = Callable[[BinaryIO], object]


def prepare_folder(folder: Path) -> list[Path]:
    """Return the folders that were created so that files can be written there, which is checked.

    Returns
    -------
    list of Path
        The folders that did not exist before, the deepest first; see `remove_empty`.

    Raises
    ------
    OutputError
        If it cannot be created or written.
    """
    try:
        created = [path for path in (folder, *folder.parents) if not path.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):  # of a name that no other process uses
            pass
    except OSError as error:
        raise unwritable(folder, error) from None
    return created


def remove_empty(folders: Sequence[Path]) -> None:
    """Remove those of the folders that are empty, the deepest first."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


Files = TypeVar("Files", bound="ResultFiles", covariant=True)


class ResultFiles(Protocol):
    """The files of one photograph."""

    @property
    def paths(self) -> tuple[Path, ...]:
        """All of them, in the order of writing."""


class ResultKind(Protocol[Files]):
    """Names the files of one photograph, as the class :class:`OutputFiles` does."""

    def __call__(self, *, folder: Path, stem: str) -> Files:
        """Return those of a photograph's name without its suffix."""


def plan_outputs(
    images: Sequence[Path], folder: Path, *, overwrite: bool, kind: ResultKind[Files]
) -> list[Files | OutputError]:
    """Return the files of each photograph, or why they must not be written.

    Parameters
    ----------
    images : sequence of Path
        The photographs of one call.
    folder : Path
        Where the files go.
    overwrite : bool
        Whether files of an earlier call may be replaced. Photographs of this call never are.
    kind : ResultKind
        What a photograph's files are, such as :class:`OutputFiles`.

    Returns
    -------
    list of Files or OutputError
        One per photograph. A second photograph of the same stem is refused, so that no result is lost.
    """
    inputs = {os.path.realpath(image) for image in images}
    first_of: dict[str, Path] = {}
    plan: list[Files | OutputError] = []
    for image in images:
        files = kind(folder=folder, stem=image.stem)
        taken = [path for path in files.paths if os.path.lexists(path)]
        hit = [path for path in files.paths if os.path.realpath(path) in inputs]
        if image.stem in first_of:
            other = first_of[image.stem]
            plan.append(OutputError(f"{image}: its results would replace those of {other}; use another -o"))
            continue
        first_of[image.stem] = image
        if hit:
            plan.append(
                OutputError(f"{image}: a result would replace the photograph {hit[0]}; use another -o")
            )
        elif taken and not overwrite:
            plan.append(OutputError(f"{image}: {taken[0]} exists; use another -o or add --overwrite"))
        else:
            plan.append(files)
    return plan


def write_atomically(path: Path, write: Write) -> None:
    """Write beside the path and rename, so that a reader never sees half a file.

    Raises
    ------
    OSError
        If the file cannot be written; nothing is left behind then.
    """
    beside = _beside(path)
    try:
        with beside.open("wb") as file:
            write(file)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def write_together(files: Mapping[Path, Write]) -> None:
    """Write files of which the last marks that all are complete: beside their paths first, then rename.

    An old last file is removed before the first rename, so that it never stands beside new ones.

    Raises
    ------
    OSError
        If a file cannot be written; the old files stay as they were then.
    """
    try:
        for path, write in files.items():
            with _beside(path).open("wb") as file:
                write(file)
        list(files)[-1].unlink(missing_ok=True)
        for path in files:
            _beside(path).replace(path)
    finally:
        for path in files:
            _beside(path).unlink(missing_ok=True)


def _beside(path: Path) -> Path:
    """Return where a file is written before it is renamed."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def unwritable(folder: Path, error: OSError) -> OutputError:
    """Return the one line about a folder that takes no files."""
    reason = error.strerror or type(error).__name__
    return OutputError(f"{folder}: results cannot be written there ({reason}); choose another folder with -o")
