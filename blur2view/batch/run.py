"""A run over many photographs: skips what is done, does the rest in any order, gives results in order."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Generic

from blur2view.batch.job import Job, Kept, Made, Outcome, Target, Work, file_digest, write_contents
from blur2view.batch.manifest import Manifest
from blur2view.batch.processes import Engine
from blur2view.camera.image import read_content
from blur2view.camera.video import EndOfVideo, frame_of
from blur2view.errors import Blur2ViewError


@dataclass(frozen=True, kw_only=True, eq=False)
class Result(Generic[Kept]):
    """One photograph of a run.

    Parameters
    ----------
    index : int
        Its place in the call.
    path : Path
        As it was named.
    made : Made or None
        None if it failed.
    error : str
        Why, one line.
    skipped : bool
        Whether an earlier call did it.
    stop : bool
        Whether the others would fail likewise.
    """

    index: int
    path: Path
    made: Made[Kept] | None = None
    error: str = ""
    skipped: bool = False
    stop: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch(Generic[Target, Kept]):
    """A run over many photographs.

    Parameters
    ----------
    work : Work
        On one photograph.
    engine : Engine
        Where it is done.
    manifest : Manifest or None
        Where it is written down, and what is done already.
    folder : Path
        That the manifest's names of files are relative to.
    sends : bool
        Whether photographs are read here and sent, as to other machines.
    """

    work: Work[Target, Kept]
    engine: Engine
    manifest: Manifest | None = None
    folder: Path = Path()
    sends: bool = False

    def results(self, jobs: Iterable[Job[Target] | Result[Kept]]) -> Generator[Result[Kept]]:
        """Yield the result of every job in their order; the manifest has it as soon as it is done.

        Parameters
        ----------
        jobs : iterable of Job or Result
            Of consecutive indices. What cannot be begun is given as its result.

        Raises
        ------
        OutputError
            If the manifest cannot be written.
        KeyboardInterrupt
            After the results that are there.
        """
        waiting: dict[int, Result[Kept] | None] = {}
        given = 0

        def ready() -> Iterator[Result[Kept]]:
            """Yield what is next in order."""
            nonlocal given
            while given in waiting:
                result = waiting.pop(given)
                given += 1
                if result is not None:
                    yield result

        try:
            with closing(self.engine(self.work, self._left(jobs, waiting))) as outcomes:
                for job, outcome in outcomes:
                    waiting[job.index] = self._received(job, outcome)
                    yield from ready()
        except KeyboardInterrupt:
            yield from (result for _, result in sorted(waiting.items()) if result is not None)
            raise
        yield from ready()

    def _left(
        self,
        jobs: Iterable[Job[Target] | Result[Kept]],
        waiting: dict[int, Result[Kept] | None],
    ) -> Iterator[Job[Target]]:
        """Yield the jobs that are to be done; the results of the others go where they wait."""
        for job in jobs:
            if isinstance(job, Result):
                waiting[job.index] = job
                continue
            try:
                made = self._found(job)
                if made is not None:
                    waiting[job.index] = Result(index=job.index, path=job.path, made=made, skipped=True)
                elif frame_of(job.path) is not None:  # a video is read once, in order
                    yield replace(job, content=read_content(job.path), digest=_digest(job.path))
                elif self.sends:
                    yield replace(job, content=read_content(job.path))
                else:
                    yield job
            except EndOfVideo:
                waiting[job.index] = None
            except Blur2ViewError as error:
                waiting[job.index] = Result(index=job.index, path=job.path, error=str(error))

    def _found(self, job: Job[Target]) -> Made[Kept] | None:
        """Return what an earlier call made of a photograph that is as it was."""
        if self.manifest is None or not self.manifest.knows(job):
            return None
        try:
            return self.manifest.find(replace(job, digest=_digest(job.path)), self.folder)
        except OSError:  # reading it will say why
            return None

    def _received(self, job: Job[Target], outcome: Outcome[Kept]) -> Result[Kept]:
        """Return the result of an outcome, written down in the manifest, after its files where they came."""
        if outcome.contents:
            outcome = write_contents(outcome)
        if self.manifest is not None and not outcome.stop:
            self.manifest.append(job, outcome, self.folder)
        return Result(
            index=job.index, path=job.path, made=outcome.made, error=outcome.error, stop=outcome.stop
        )


def _digest(path: Path) -> str:
    """Return the SHA-256 of a photograph's file, of a frame that of its video."""
    frame = frame_of(path)
    return file_digest(path) if frame is None else _video_digest(frame[0])


@cache
def _video_digest(video: Path) -> str:
    """Return the SHA-256 of a video, computed once."""
    return file_digest(video)
