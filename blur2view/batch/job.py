"""One photograph's work: what goes to the process that does it, and what comes back."""

from __future__ import annotations

import errno
import hashlib
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from blur2view.camera.image import read_content
from blur2view.errors import Blur2ViewError, RunError, within_memory
from blur2view.output_files import Write, unwritable, write_together

Target = TypeVar("Target")
Kept = TypeVar("Kept")
# the next photograph's files would not fit either
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG}


@dataclass(frozen=True, kw_only=True, eq=False)
class Job(Generic[Target]):
    """One photograph, as it goes to the process that works on it; picklable.

    Parameters
    ----------
    index : int
        Its place in the call.
    path : Path
        As the user named it; ``VIDEO/000120`` is a frame.
    target : Target
        What the work needs besides: where its files go, or its name in a database.
    content : bytes or None
        The file, where it has been read already.
    digest : str
        SHA-256 of the photograph's file; empty where the content is still to be read.
    source : str
        What its result depends on besides, such as its features in a database.
    """

    index: int
    path: Path
    target: Target
    content: bytes | None = None
    digest: str = ""
    source: str = ""

    @property
    def encoded(self) -> bytes:
        """Return the file's content, read if need be."""
        return read_content(self.path) if self.content is None else self.content


@dataclass(frozen=True, kw_only=True, eq=False)
class Made(Generic[Kept]):
    """What the work on one photograph gives.

    Parameters
    ----------
    kept : Kept
        What the command needs in the end; picklable, of dataclasses, enums and arrays.
    summary : str
        What is printed; its first line stands for the photograph where there are many.
    files : mapping of Path to Write
        What to write, in this order; the last marks that all are there.
    row : mapping of str, optional
        The photograph's row in a table, of JSON's types.
    warnings : tuple of str
        Each begins with the option that it is about.
    """

    kept: Kept
    summary: str
    files: Mapping[Path, Write] = field(default_factory=dict)
    row: Mapping[str, Any] | None = None
    warnings: tuple[str, ...] = ()


Work = Callable[[Job[Target]], Made[Kept]]
"""Picklable: a frozen dataclass with ``__call__``. It raises a Blur2ViewError where a photograph fails."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome(Generic[Kept]):
    """What comes back of one photograph.

    Parameters
    ----------
    made : Made or None
        Without its files; None if it failed.
    digest : str
        As of `Job`.
    outputs : mapping of Path to str
        SHA-256 of every file.
    contents : mapping of Path to bytes
        The files that are still to be written.
    error : str
        Why it failed, one line.
    stop : bool
        Whether the others would fail likewise.
    """

    made: Made[Kept] | None = None
    digest: str = ""
    outputs: Mapping[Path, str] = field(default_factory=dict)
    contents: Mapping[Path, bytes] = field(default_factory=dict)
    error: str = ""
    stop: bool = False


def perform(work: Work[Target, Kept], job: Job[Target], *, write: bool = True) -> Outcome[Kept]:
    """Return the outcome of one photograph, after writing its files; errors of the user's are data.

    Parameters
    ----------
    work : Work
    job : Job
    write : bool
        Otherwise the files come back as contents.
    """
    try:
        with within_memory(job.path):
            job = replace(job, content=job.encoded)
            digest = job.digest or hashlib.sha256(job.encoded).hexdigest()
            made = work(job)
            outcome = Outcome(made=replace(made, files={}), digest=digest, contents={})
            outcome = replace(outcome, **(_written(made.files) if write else _rendered(made.files)))
    except Blur2ViewError as error:
        return Outcome(error=str(error), stop=isinstance(error, RunError))
    return outcome


def write_contents(outcome: Outcome[Kept]) -> Outcome[Kept]:
    """Return an outcome whose contents are written; it is a failure if they cannot be."""
    files = {path: _writer(content) for path, content in outcome.contents.items()}
    try:
        return replace(outcome, contents={}, **_written(files))
    except Blur2ViewError as error:
        return Outcome(error=str(error), stop=isinstance(error, RunError))


def _writer(content: bytes) -> Write:
    """Return what writes bytes."""
    return lambda file: file.write(content)


def _written(files: Mapping[Path, Write]) -> dict[str, Any]:
    """Return the digests of files, after writing them together."""
    if not files:
        return {}
    folder = next(iter(files)).parent
    try:
        write_together(files)
        return {"outputs": {path: file_digest(path) for path in files}}
    except OSError as error:
        failed = unwritable(folder, error)
        raise (RunError(str(failed)) if error.errno in FULL else failed) from None


def _rendered(files: Mapping[Path, Write]) -> dict[str, Any]:
    """Return the contents of files."""
    contents = {}
    for path, write in files.items():
        stream = io.BytesIO()
        write(stream)
        contents[path] = stream.getvalue()
    return {"contents": contents}


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits; what says that it is empty is not read."""
    if not path.stat().st_size:
        return hashlib.sha256().hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
