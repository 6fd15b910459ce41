"""One photograph's work: what goes to the process that does it, and what comes back."""

from __future__ import annotations

import errno
import hashlib
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from blur2view.errors import Blur2ViewError, RunError, within_memory
from blur2view.file_writing import unwritable, write_files
from blur2view.photographs.image import read_content
from blur2view.results.table import Row
from blur2view.runs.neighbours import Neighbour

Target = TypeVar("Target")
Kept = TypeVar("Kept")
# the next photograph's files would not fit either
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG}


@dataclass(frozen=True, kw_only=True, eq=False)
class Job(Generic[Target]):
    """One photograph, as it goes to the process that works on it.

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
        What its result depends on besides it and its neighbours, such as its features in a database.
    frame : int or None
        Its number in its video.
    timestamp_s : float or None
        Its time in its video, seconds.
    neighbours : tuple of Neighbour
        Photographs that decide its order in time.
    """

    index: int
    path: Path
    target: Target
    content: bytes | None = None
    digest: str = ""
    source: str = ""
    frame: int | None = None
    timestamp_s: float | None = None
    neighbours: tuple[Neighbour, ...] = ()

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
        What the command needs in the end.
    summary : str
        What is printed; its first line stands for the photograph where there are many.
    row : Row
        The photograph's row in a table, without its name.
    files : mapping of Path to bytes
        What to write, in this order; the last marks that all are there.
    warnings : tuple of str
        Each begins with the option that it is about.
    """

    kept: Kept
    summary: str
    row: Row
    files: Mapping[Path, bytes] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


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
    """What comes back of one photograph.

    Parameters
    ----------
    made : Made or None
        Without its files where they are written; None if it failed.
    digest : str
        As of `Job`.
    outputs : mapping of Path to str
        SHA-256 of every file.
    error : str
        Why it failed, one line.
    stop : bool
        Whether the others would fail likewise.
    skipped : bool
        Whether an earlier call did it.
    """

    made: Made[Kept] | None = None
    digest: str = ""
    outputs: Mapping[Path, str] = field(default_factory=dict)
    error: str = ""
    stop: bool = False
    skipped: bool = False


def failed(error: Blur2ViewError) -> Outcome[Any]:
    """Return the outcome of a photograph that fails."""
    return Outcome(error=str(error), stop=isinstance(error, RunError))


def perform(work: Work[Target, Kept], job: Job[Target], *, write: bool = True) -> Outcome[Kept]:
    """Return the outcome of one photograph, after writing its files; errors of the user's are data.

    Without ``write`` the files come back.
    """
    try:
        with within_memory(job.path):
            job = replace(job, content=job.encoded)
            digest = job.digest or hashlib.sha256(job.encoded).hexdigest()
            made = work(job)
            outcome = Outcome(made=made, digest=digest)
            return written(outcome) if write else outcome
    except Blur2ViewError as error:
        return failed(error)


def written(outcome: Outcome[Kept]) -> Outcome[Kept]:
    """Return an outcome whose files are written; it is a failure if they cannot be."""
    if outcome.made is None or not (files := outcome.made.files):
        return outcome
    try:
        write_files(files)
    except OSError as error:
        refusal = unwritable(next(iter(files)).parent, error)
        return failed(RunError(str(refusal)) if error.errno in FULL else refusal)
    outputs = {path: hashlib.sha256(content).hexdigest() for path, content in files.items()}
    return replace(outcome, made=replace(outcome.made, files={}), outputs=outputs)


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits; what says that it is empty is not read."""
    if not path.stat().st_size:
        return hashlib.sha256().hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
