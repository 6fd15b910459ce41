"""Jobs, a photograph each: what goes to the process that does one, and what comes back."""

import errno
import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from blur2view.errors import Blur2ViewError, ImageError, OutputError, within_memory
from blur2view.images.inputs import Source
from blur2view.images.video import EndOfVideo, frame_time
from blur2view.output_files import file_digest, unwritable, write_files
from blur2view.results.photograph import Photograph

FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG}
"""Errors after which the next photograph's files would not fit either."""
Neighbours = tuple[tuple[int, Source], ...]
"""Photographs beside another one in time, which help to decide its order: -1 or 1 step to each."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """One photograph, as it goes to the process that works on it."""

    source: Source
    name: str = ""  # in tables and databases
    files: tuple[Path, ...] = ()  # where its results go, in the order of writing, its JSON last
    neighbours: Neighbours = ()
    refusal: Blur2ViewError | None = None  # why it cannot be begun
    contents: Mapping[Source, bytes] = field(default_factory=dict)  # of its file and its neighbours'
    input_sha256: str = ""  # of its file
    options_sha256: str = ""  # of the call's options, and of all else that its result depends on

    @property
    def content(self) -> bytes:
        """The content of its file."""
        return self.contents[self.source]


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What comes of one photograph."""

    photograph: Photograph
    summary: str = ""  # what is printed; its first line stands for the photograph where there are many
    files: Mapping[Path, bytes] = field(default_factory=dict)  # to be written together, in this order
    besides: Mapping[str, Any] = field(default_factory=dict)  # what the command needs of it in the end
    skipped: bool = False  # whether an earlier call did it

    @property
    def error(self) -> str:
        """Why it failed, one line; empty if it is done."""
        return self.photograph.error


Work = Callable[[Any], Outcome]
"""What is done with every job, in whichever process. Blur2ViewError of what fails."""
Find = Callable[[Job], Outcome | None]


def begin(job: Job, find: Find) -> tuple[Job, Outcome | None]:
    """Return a job with digests and contents, and its outcome if it fails at once or ``find`` knows it.

    EndOfVideo of a frame that its video does not have.
    """
    try:
        if job.refusal is not None:
            raise job.refusal
        job = _identified(job)
        found = find(job)
        return (_read(job), None) if found is None else (job, found)
    except EndOfVideo:
        raise
    except Blur2ViewError as error:
        return job, failed(job.name, error)


def written(outcome: Outcome) -> Outcome:
    """Return an outcome whose files are written, or a failure; OutputError on a full disk."""
    try:
        if outcome.files:
            write_files(outcome.files)
    except OSError as error:
        refusal = unwritable(next(iter(outcome.files)).parent, error)
        if error.errno in FULL:
            raise refusal from None
        name = outcome.photograph.name
        return failed(name, OutputError(f"{name}: {refusal}"))
    return replace(outcome, files={})


def _read(job: Job) -> Job:
    """Return a job with all contents, of a frame with its time; neighbours that cannot be read are left out.

    A video is read in order.
    """
    contents, source = {}, job.source
    for _, one in sorted([(0, source), *job.neighbours], key=lambda pair: pair[0]):
        try:
            contents[one] = one.read()
        except ImageError:
            if one == source:
                raise
    if source.frame is not None:
        source = replace(source, time_s=frame_time(source.path, source.frame))
    return replace(job, source=source, contents=contents)


def perform(work: Work, job: Job) -> Outcome:
    """Return the outcome of one photograph, its files unwritten; errors of the user's are data."""
    try:
        with within_memory(job.source.path):
            return work(job)
    except Blur2ViewError as error:
        return failed(job.name, error)


def failed(name: str, error: Blur2ViewError) -> Outcome:
    """Return the outcome of a photograph that fails."""
    return Outcome(photograph=Photograph(name=name, error=str(error)))


def _identified(job: Job) -> Job:
    """Return a job with the digest of its file, and of what else its result depends on: its neighbours."""
    near = [_digest_of(one.path) for _, one in job.neighbours] if job.source.frame is None else []
    every = job.options_sha256, job.source.frame, [steps for steps, _ in job.neighbours], near
    digest = hashlib.sha256(repr(every).encode()).hexdigest()
    return replace(job, input_sha256=_digest_of(job.source.path), options_sha256=digest)


def _digest_of(path: Path) -> str:
    """Return the SHA-256 of a photograph's or video's file, empty where it cannot be read."""
    with suppress(OSError, ValueError):  # ValueError of a name with a null character
        return _digest(path, path.stat().st_size, path.stat().st_mtime_ns)
    return ""


@lru_cache(maxsize=8)
def _digest(path: Path, size: int, changed_ns: int) -> str:
    """Return the SHA-256 of a file as it was changed last: each frame of a video asks for it."""
    return file_digest(path)


def neighbours_of(sources: Sequence[Source], sequence: bool | None) -> list[Neighbours]:
    """Return the neighbours of each photograph, the earlier one first.

    Of a frame those beside it in its video; with ``sequence`` of other photographs those that are named
    beside them and lie in the same folder; if it is False none.
    """
    if sequence is False:
        return [()] * len(sources)
    stills = [None, *(one for one in sources if one.frame is None), None] if sequence else []
    place = {one: index for index, one in enumerate(stills) if one}
    found = []
    for one in sources:
        near = [
            (steps, stills[place[one] + steps] if one in place else one.beside(steps)) for steps in (-1, 1)
        ]
        found.append(tuple((steps, other) for steps, other in near if other and other.folder == one.folder))
    return found
