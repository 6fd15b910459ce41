"""Jobs, a photograph each: what goes to the process that does one, what comes back, and the loop over all."""

import errno
import hashlib
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from blur2view.errors import Blur2ViewError, ImageError, OutputError, RunError, within_memory
from blur2view.images.source import Source, read_content
from blur2view.images.video import EndOfVideo, frame_time
from blur2view.input_files import open_regular
from blur2view.output_files import file_digest, unwritable, write_files
from blur2view.results.photograph import Photograph

WHOLE_BYTES, END_BYTES = 1 << 30, 1 << 20  # a larger file, a video, is known by its length and both ends
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG}
"""Errors after which the next photograph's files would not fit either."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbour:
    """A photograph beside another one in time, whose order it helps to decide."""

    source: Source
    steps: int  # -1 or 1 to it
    content: bytes | None = None  # of its file, where that has been read already


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """One photograph, as it goes to the process that works on it."""

    index: int  # its place in the call
    source: Source
    name: str = ""  # in tables and databases
    files: tuple[Path, ...] = ()  # where its results go, in the order of writing, its JSON last
    neighbours: tuple[Neighbour, ...] = ()
    refusal: Blur2ViewError | None = None  # why it cannot be begun
    content: bytes | None = None  # of its file, where that has been read already
    input_sha256: str = ""  # of its file
    depends_on: str = ""  # all else that its result depends on, but for the options of the call


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What comes of one photograph."""

    photograph: Photograph
    summary: str = ""  # what is printed; its first line stands for the photograph where there are many
    files: Mapping[Path, bytes] = field(default_factory=dict)  # to be written together, in this order
    besides: Mapping[str, Any] = field(default_factory=dict)  # what the command needs of it in the end
    warnings: tuple[str, ...] = ()  # each begins with the option that it is about
    skipped: bool = False  # whether an earlier call did it

    @property
    def error(self) -> str:
        """Why it failed, one line; empty if it is done."""
        return self.photograph.error


Done = Generator[tuple[Job, Outcome]]
Work = Callable[[Any], Outcome]
"""What is done with every job, also in other processes. Blur2ViewError of what fails."""
Executor = Callable[[Work, Iterator[Job]], Done]
"""Does jobs, each taken when there is room for it, and yields it with its outcome when done, in any order."""
Find = Callable[[Job], Outcome | None]
Waiting = dict[int, tuple[Job, Outcome] | None]
"""By index, until it is their turn; None for a frame that its video does not have."""


def outcomes(
    work: Work, jobs: Iterable[Job], executor: Executor, *, find: Find = lambda job: None, sends: bool = False
) -> Done:
    """Yield every job, of consecutive indices, with its outcome in their order, its files written.

    Parameters
    ----------
    work : callable
        Does a job, wherever the executor runs it.
    jobs : iterable of Job
        The photographs in order.
    executor : callable
        As `runs.executors.executor` returns it.
    find : callable
        Returns the outcome of a job that an earlier call did; it is not done again.
    sends : bool
        Whether photographs are read here and sent, as to other machines.

    Raises
    ------
    OutputError, RunError, KeyboardInterrupt
        If no photograph can be done any more; after the outcomes that are there.
    """
    waiting: Waiting = {}
    turn = 0
    try:
        with closing(executor(work, _left(jobs, find, waiting, sends=sends))) as done:
            for job, outcome in done:
                waiting[job.index] = replace(job, content=None, neighbours=()), _written(job, outcome)
                while turn in waiting:
                    if (pair := waiting.pop(turn)) is not None:
                        yield pair
                    turn += 1
    except (KeyboardInterrupt, OutputError, RunError):
        yield from filter(None, (waiting[index] for index in sorted(waiting)))
        raise
    yield from filter(None, (waiting[index] for index in sorted(waiting)))


def _written(job: Job, outcome: Outcome) -> Outcome:
    """Return an outcome whose files are written, or a failure; OutputError on a full disk."""
    try:
        if outcome.files:
            write_files(outcome.files)
    except OSError as error:
        refusal = unwritable(next(iter(outcome.files)).parent, error)
        if error.errno in FULL:
            raise refusal from None
        return failed(job, refusal)
    return replace(outcome, files={})


def _left(jobs: Iterable[Job], find: Find, waiting: Waiting, *, sends: bool) -> Iterator[Job]:
    """Yield the jobs that are to be done; the outcomes of the others go where they wait.

    That a video is cut off is said once.
    """
    cut: set[Path] = set()
    for job in jobs:
        try:
            if job.refusal is not None:
                raise job.refusal
            if (outcome := find(job)) is not None:
                waiting[job.index] = job, outcome
            else:  # a video is read once, in order
                yield _read(job) if sends or job.source.frame is not None else job
        except EndOfVideo as end:
            said = end.whole or job.source.path in cut
            waiting[job.index] = None if said else (job, failed(job, end))
            cut.add(job.source.path)
        except Blur2ViewError as error:
            waiting[job.index] = job, failed(job, error)


def _read(job: Job) -> Job:
    """Return a job with its content and those before and after it, of a frame with its time in the video."""
    before = _with_contents(one for one in job.neighbours if one.steps < 0)
    read = replace(job, content=content_of(job))
    after = _with_contents(one for one in job.neighbours if one.steps > 0)
    read = replace(identified(read), neighbours=before + after)
    source = job.source
    if source.frame is None:
        return read
    return replace(read, source=replace(source, time_s=frame_time(source.path, source.frame)))


def _with_contents(neighbours: Iterable[Neighbour]) -> tuple[Neighbour, ...]:
    """Return neighbours with their contents, without those that cannot be read."""
    read: list[Neighbour] = []
    for one in neighbours:
        with suppress(ImageError):
            read.append(replace(one, content=content_of(one)))
    return tuple(read)


def perform(work: Work, job: Job) -> Outcome:
    """Return the outcome of one photograph, its files unwritten; errors of the user's are data.

    RunError if every other photograph would fail likewise.
    """
    try:
        with within_memory(job.source.path):
            return work(identified(replace(job, content=content_of(job))))
    except RunError:
        raise
    except Blur2ViewError as error:
        return failed(job, error)
    except OSError as error:  # as where a process may open no more files
        return failed(job, ImageError(f"{job.source}: cannot be read ({error.strerror or error}); try again"))


def failed(job: Job, error: Blur2ViewError) -> Outcome:
    """Return the outcome of a photograph that fails."""
    return Outcome(photograph=Photograph(name=job.name, error=str(error)))


def content_of(one: Job | Neighbour) -> bytes:
    """Return the content of a file, read if need be; ImageError if it cannot be."""
    return read_content(one.source) if one.content is None else one.content


def identified(job: Job) -> Job:
    """Return a job with the digest of its file, and with what else its result depends on."""
    if job.input_sha256:
        return job
    one, known = job.source, job.content is not None and job.source.frame is None
    digest = hashlib.sha256(job.content or b"").hexdigest() if known else digest_of(one.path)
    if one.frame is None:
        near = (f"{other.steps:+d} {digest_of(other.source.path)}" for other in job.neighbours)
        depends_on = "; ".join([f"{one.time_s}", *near])
    else:  # its time and its neighbours follow from its video
        depends_on = f"frame {one.frame}; {len(job.neighbours)}"
    return replace(job, input_sha256=digest, depends_on=depends_on)


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a photograph's or video's file, empty where it cannot be read.

    Of what is larger than `WHOLE_BYTES` that of its length and both its ends.
    """
    try:
        status = path.stat()
        return _digest(path, status.st_size, status.st_mtime_ns)
    except (OSError, ValueError):  # of a name with a null character
        return ""


@lru_cache(maxsize=8)
def _digest(path: Path, size: int, changed_ns: int) -> str:
    """Return the SHA-256 of a file as it was changed last: each frame of a video asks for it."""
    if size <= WHOLE_BYTES:
        return file_digest(path)
    with open_regular(path) as file:
        digest = hashlib.sha256(f"{size}".encode())
        for place in (0, size - END_BYTES):
            file.seek(place)
            digest.update(file.read(END_BYTES))
        return digest.hexdigest()


def neighbours_of(sources: Sequence[Source], sequence: bool | None) -> list[tuple[Neighbour, ...]]:
    """Return the neighbours of each photograph, the earlier one first.

    Of a frame those beside it in its video; with ``sequence`` of other photographs those that are named
    beside them and lie in the same folder; if it is False none.
    """
    if sequence is False:
        return [()] * len(sources)
    files = [None, *(one for one in sources if one.frame is None), None] if sequence else []
    place, found = {one: index for index, one in enumerate(files) if one}, []
    for one in sources:
        near = {steps: one.beside(steps) for steps in (-1, 1)}
        if one in place:
            near = {steps: files[place[one] + steps] for steps in (-1, 1)}
        beside = [(steps, other) for steps, other in near.items() if other and other.folder == one.folder]
        found.append(tuple(Neighbour(source=other, steps=steps) for steps, other in beside))
    return found
