"""One photograph's work: what goes to the process that does it, and what comes back."""

import hashlib
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from blur2view.errors import Blur2ViewError, ImageError, RunError, within_memory
from blur2view.images.content import read_content
from blur2view.images.source import Source
from blur2view.input_files import open_regular
from blur2view.results.photograph import Photograph

WHOLE_BYTES, END_BYTES = 1 << 30, 1 << 20  # a larger file, a video, is known by its length and both ends


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
    besides: str = ""  # what its result depends on besides it and these, as features in a database
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
    besides: Mapping[str, Any] = field(
        default_factory=dict
    )  # what the command needs in the end, JSON's types
    warnings: tuple[str, ...] = ()  # each begins with the option that it is about
    stop: bool = False  # whether the others would fail likewise
    skipped: bool = False  # whether an earlier call did it

    @property
    def error(self) -> str:
        """Why it failed, one line; empty if it is done."""
        return self.photograph.error


Done = Generator[tuple[Job, Outcome]]
Work = Callable[[Any], Outcome]
"""What is done with every job, also in other processes. Blur2ViewError of what fails."""


def failed(job: Job, error: Blur2ViewError) -> Outcome:
    """Return the outcome of a photograph that fails."""
    return Outcome(photograph=Photograph(name=job.name, error=str(error)), stop=isinstance(error, RunError))


def perform(work: Work, job: Job) -> Outcome:
    """Return the outcome of one photograph, its files unwritten; errors of the user's are data."""
    try:
        with within_memory(job.source.path):
            return work(identified(replace(job, content=content_of(job))))
    except Blur2ViewError as error:
        return failed(job, error)
    except OSError as error:  # as where a process may open no more files
        return failed(job, ImageError(f"{job.source}: cannot be read ({error.strerror or error}); try again"))


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
        near = [f"{other.steps:+d} {digest_of(other.source.path)}" for other in job.neighbours]
        depends_on = [f"{one.time_s}", *near, job.besides]
    else:  # its time and its neighbours follow from its video
        depends_on = [f"frame {one.frame}", f"{len(job.neighbours)}", job.besides]
    return replace(job, input_sha256=digest, depends_on="; ".join(depends_on))


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
    with open_regular(path) as file:
        if size <= WHOLE_BYTES:
            return hashlib.file_digest(file, "sha256").hexdigest()
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
    files = [one for one in sources if one.frame is None] if sequence else []
    place, found = {one: index for index, one in enumerate(files)}, []
    for one in sources:
        near: dict[int, Source | None] = {steps: one.beside(steps) for steps in (-1, 1)}
        if one in place:
            here = place[one]
            near = {
                -1: files[here - 1] if here else None,
                1: files[here + 1] if here + 1 < len(files) else None,
            }
        beside = [(steps, other) for steps, other in near.items() if other and other.folder == one.folder]
        found.append(tuple(Neighbour(source=other, steps=steps) for steps, other in beside))
    return found


def with_contents(neighbours: Iterable[Neighbour]) -> tuple[Neighbour, ...]:
    """Return neighbours with their contents, without those that cannot be read."""
    read: list[Neighbour] = []
    for one in neighbours:
        with suppress(ImageError):
            read.append(replace(one, content=content_of(one)))
    return tuple(read)
