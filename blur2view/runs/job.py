"""One photograph's work: what goes to the process that does it, and what comes back."""

from __future__ import annotations

import errno
import hashlib
import io
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from operator import methodcaller
from pathlib import Path
from typing import Any, Generic, TypeVar

from blur2view.errors import Blur2ViewError, RunError, within_memory
from blur2view.file_writing import Write, unwritable, write_together
from blur2view.photographs.image import read_content
from blur2view.results.table import Row
from blur2view.runs.neighbours import Neighbour

Target = TypeVar("Target")
Kept = TypeVar("Kept")
# the next photograph's files would not fit either
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG}


@dataclass(frozen=True, kw_only=True, eq=False)
class Job(Generic[Target]):
    """One photograph, as it goes to the process that works on it."""

    index: int  # its place in the call
    path: Path  # as the user named it; VIDEO/000120 is a frame
    target: Target  # what the work needs besides: where its files go, or its name in a database
    content: bytes | None = None  # of its file, where it has been read already
    digest: str = ""  # SHA-256 of its file; empty where the content is still to be read
    source: str = ""  # what its result depends on besides it and its neighbours, such as its features
    frame: int | None = None  # its number in its video
    timestamp_s: float | None = None  # its time there
    neighbours: tuple[Neighbour, ...] = ()  # photographs that decide its order in time

    @property
    def encoded(self) -> bytes:
        """Return the file's content, read if need be."""
        return read_content(self.path) if self.content is None else self.content


@dataclass(frozen=True, kw_only=True, eq=False)
class Made(Generic[Kept]):
    """What the work on one photograph gives."""

    kept: Kept  # what the command needs in the end
    summary: str  # what is printed; its first line stands for the photograph where there are many
    row: Row  # of a table, without the photograph's name
    files: Mapping[Path, Write] = field(default_factory=dict)  # the last marks that all are there
    warnings: tuple[str, ...] = ()  # each begins with the option that it is about


class Work(ABC, Generic[Target, Kept]):
    """What is done with every photograph: a frozen dataclass of all that the result depends on."""

    @abstractmethod
    def __call__(self, job: Job[Target]) -> Made[Kept]:
        """Return what is made of a photograph; Blur2ViewError where it fails."""

    def stored(self, kept: Kept) -> Any:
        """Return what a manifest holds of what is kept, in JSON's types; nothing where files hold it."""

    @abstractmethod
    def restored(self, job: Job[Target], stored: Any) -> Kept:
        """Return what is kept, of what a manifest or the job's files hold, which may be anything.

        OSError or one of `stored.DAMAGE` where that cannot be: then the work is done again.
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome(Generic[Kept]):
    """What comes back of one photograph."""

    made: Made[Kept] | None = None  # without its files; None if it failed
    digest: str = ""  # as of `Job`
    outputs: Mapping[Path, str] = field(default_factory=dict)  # SHA-256 of every file
    contents: Mapping[Path, bytes] = field(default_factory=dict)  # of files that are still to be written
    error: str = ""  # why it failed, one line
    stop: bool = False  # whether the others would fail likewise
    skipped: bool = False  # whether an earlier call did it


def failed(error: Blur2ViewError) -> Outcome[Any]:
    """Return the outcome of a photograph that fails."""
    return Outcome(error=str(error), stop=isinstance(error, RunError))


def perform(work: Work[Target, Kept], job: Job[Target], *, write: bool = True) -> Outcome[Kept]:
    """Return the outcome of one photograph, after writing its files; errors of the user's are data.

    Without ``write`` the files come back as contents.
    """
    try:
        with within_memory(job.path):
            job = replace(job, content=job.encoded)
            digest = job.digest or hashlib.sha256(job.encoded).hexdigest()
            made = work(job)
            outcome = Outcome(made=replace(made, files={}), digest=digest)
            if write:
                return replace(outcome, outputs=_written(made.files))
            return replace(outcome, contents={path: _content(one) for path, one in made.files.items()})
    except Blur2ViewError as error:
        return failed(error)


def write_contents(outcome: Outcome[Kept]) -> Outcome[Kept]:
    """Return an outcome whose contents are written; it is a failure if they cannot be."""
    files = {path: methodcaller("write", content) for path, content in outcome.contents.items()}
    try:
        return replace(outcome, contents={}, outputs=_written(files))
    except Blur2ViewError as error:
        return failed(error)


def _content(write: Write) -> bytes:
    """Return the content of a file."""
    stream = io.BytesIO()
    write(stream)
    return stream.getvalue()


def _written(files: Mapping[Path, Write]) -> dict[Path, str]:
    """Return the digests of files, after writing them together."""
    try:
        if files:
            write_together(files)
        return {path: file_digest(path) for path in files}
    except OSError as error:
        refusal = unwritable(next(iter(files)).parent, error)
        raise (RunError(str(refusal)) if error.errno in FULL else refusal) from None


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits; what says that it is empty is not read."""
    if not path.stat().st_size:
        return hashlib.sha256().hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
