"""The job for one photograph, as the process gets it that works on it, and its outcome."""

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from blur2view.errors import Blur2ViewError
from blur2view.exposure.sequence import Features, Matches
from blur2view.images.image import Content
from blur2view.images.inputs import Source
from blur2view.records.record import Record

Neighbours = tuple[tuple[int, Source], ...]
"""The photographs before (-1) and after (1) a photograph, which help to decide the order of its ends."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """The job for one photograph, as the process gets it that works on it."""

    source: Source
    name: str = ""  # in tables and databases
    files: tuple[Path, ...] = ()  # files of its results, in the order of writing, its JSON last
    neighbours: Neighbours = ()
    refusal: Blur2ViewError | None = None  # why the job cannot begin
    plan: Any = None  # what its command already knows about it
    content: Content | None = None  # of its file, or a frame's pixels
    beside: Mapping[Source, Content] = field(default_factory=dict)  # contents of itself and its neighbours
    matches: Mapping[int, Matches] = field(default_factory=dict)  # with its neighbours, by steps in time
    input_sha256: str = ""  # of its file
    call_sha256: str = ""  # of the call's options, network and version
    job_sha256: str = ""  # of these and of all else that its result depends on


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """The result of the job for one photograph."""

    record: Record
    summary: str = ""  # what is printed; its first line stands for the photograph where there are many
    contents: Sequence[bytes] = ()  # of the job's files but the last, which is the record
    part: Any = None  # for what the command makes of all photographs
    skipped: bool = False  # whether an earlier call did the job

    @property
    def error(self) -> str:
        """Why the job failed, in one line; empty if it is done."""
        return self.record.error


Work = Callable[[Any], Outcome]
"""Does a job, in whichever process; Blur2ViewError of a job that fails."""
Find = Callable[[Job], Outcome | None]
"""Finds the outcome of a job that an earlier call did."""
Look = Callable[[Source, Content], Features]
"""Finds the features of a photograph, in whichever process; Blur2ViewError if it cannot be read."""
Done = Generator[tuple[Job, Outcome]]


def failed(name: str, error: Blur2ViewError) -> Outcome:
    """Return the outcome of a photograph that failed."""
    return Outcome(record=Record(name=name, error=str(error)))


def neighbours_in_time(sources: Sequence[Source], sequence: bool | None) -> list[Neighbours]:
    """Return the neighbours of each photograph, the earlier one first.

    Those of a frame lie beside it in its video; with ``sequence`` those of other photographs are named beside
    them and lie in the same folder; if ``sequence`` is False nothing has neighbours.
    """
    if sequence is False:
        return [()] * len(sources)
    after = dict(pairwise(source for source in sources if source.frame is None)) if sequence else {}
    before = {later: earlier for earlier, later in after.items()}
    neighbours = []
    for source in sources:
        candidates = (-1, before.get(source) or source.beside(-1)), (1, after.get(source) or source.beside(1))
        neighbours.append(
            tuple((k, other) for k, other in candidates if other and other.folder == source.folder)
        )
    return neighbours
