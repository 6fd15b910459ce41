"""One photograph's work: what goes to the process that does it, and what comes back."""

import errno
import hashlib
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from blur2view.errors import Blur2ViewError, ImageError, RunError, within_memory
from blur2view.images.content import read_content
from blur2view.images.video import frame_of, frame_path
from blur2view.output_files import unwritable, write_files
from blur2view.results.table import Row

# the next photograph's files would not fit either
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG}


@dataclass(frozen=True, kw_only=True, eq=False)
class Photograph:
    """A photograph's file, with its content where that has been read already."""

    path: Path  # as the user named it; VIDEO/000120 is a frame
    content: bytes | None = None
    steps: int = 0  # -1 or 1 to it from the one that it is before or after in time, whose order it decides

    @property
    def encoded(self) -> bytes:
        """Return the file's content, read if need be; ImageError if it cannot be."""
        return read_content(self.path) if self.content is None else self.content


@dataclass(frozen=True, kw_only=True, eq=False)
class Job(Photograph):
    """One photograph, as it goes to the process that works on it."""

    index: int  # its place in the call
    name: str = ""  # in tables and databases
    files: tuple[Path, ...] = ()  # where its results go, in the order of writing, its document last
    target: Any = None  # what the work needs besides, as its plan in a database
    refusal: Blur2ViewError | None = None  # why it cannot be begun
    digest: str = ""  # SHA-256 of the file; empty where the content is still to be read
    # what its result depends on besides it and its neighbours, such as features in a database
    source: str = ""
    frame: int | None = None  # its number in its video
    timestamp_s: float | None = None  # its time there
    neighbours: tuple[Photograph, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What comes of one photograph."""

    payload: Any = None  # what the command needs in the end
    summary: str = ""  # what is printed; its first line stands for the photograph where there are many
    row: Row = Row()  # of a table, without the name
    files: Mapping[Path, bytes] = field(default_factory=dict)  # to be written together, in this order
    warnings: tuple[str, ...] = ()  # each begins with the option that it is about
    digest: str = ""  # as of `Job`
    outputs: Mapping[Path, str] = field(default_factory=dict)  # SHA-256 of every file that is written
    error: str = ""  # why it failed, one line; empty if it is done
    stop: bool = False  # whether the others would fail likewise
    skipped: bool = False  # whether an earlier call did it


Done = Generator[tuple[Job, Outcome]]
Work = Callable[[Job], Outcome]
"""What is done with every photograph, also in other processes: all that the result depends on.

The payload is of JSON's types where a manifest is to hold it. Blur2ViewError of what fails.
"""


def failed(error: Blur2ViewError) -> Outcome:
    """Return the outcome of a photograph that fails."""
    return Outcome(error=str(error), stop=isinstance(error, RunError))


def perform(work: Work, job: Job) -> Outcome:
    """Return the outcome of one photograph, its files unwritten; errors of the user's are data."""
    try:
        with within_memory(job.path):
            job = replace(job, content=job.encoded)
            digest = job.digest or hashlib.sha256(job.encoded).hexdigest()
            return replace(work(job), digest=digest)
    except Blur2ViewError as error:
        return failed(error)


def written(outcome: Outcome) -> Outcome:
    """Return an outcome whose files are written; it is a failure if they cannot be."""
    if not (files := outcome.files):
        return outcome
    try:
        write_files(files)
    except OSError as error:
        refusal = unwritable(next(iter(files)).parent, error)
        return failed(RunError(str(refusal)) if error.errno in FULL else refusal)
    outputs = {path: hashlib.sha256(content).hexdigest() for path, content in files.items()}
    return replace(outcome, files={}, outputs=outputs)


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits; what says that it is empty is not read."""
    if not path.stat().st_size:
        return hashlib.sha256().hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


_video_digest = cache(file_digest)


def photograph_digest(path: Path) -> str:
    """Return the SHA-256 of a photograph's file, of a frame that of its video, computed once."""
    frame = frame_of(path)
    return file_digest(path) if frame is None else _video_digest(frame[0])


def neighbours_of(paths: Sequence[Path], sequence: bool | None) -> dict[Path, tuple[Photograph, ...]]:
    """Return the neighbours of each photograph, the earlier one first.

    Of a frame those beside it in its video; with ``sequence`` of other photographs those that are named
    beside them and lie in the same folder; if it is False none.
    """
    files = [path for path in paths if frame_of(path) is None] if sequence else []
    named = dict(enumerate(files)).get
    place = {path: index for index, path in enumerate(files)}
    neighbours: dict[Path, tuple[Photograph, ...]] = {}
    for path in paths:
        beside = {}
        for steps in (-1, 1) if sequence is not False else ():
            if (frame := frame_of(path)) is not None and frame[1] + steps >= 0:
                beside[steps] = frame_path(frame[0], frame[1] + steps)
            elif path in place and (other := named(place[path] + steps)) and other.parent == path.parent:
                beside[steps] = other
        neighbours[path] = tuple(Photograph(path=other, steps=steps) for steps, other in beside.items())
    return neighbours


def with_contents(neighbours: Iterable[Photograph]) -> tuple[Photograph, ...]:
    """Return neighbours with their contents, without those that cannot be read."""
    read: list[Photograph] = []
    for one in neighbours:
        with suppress(ImageError):
            read.append(replace(one, content=one.encoded))
    return tuple(read)
