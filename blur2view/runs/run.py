"""A run over many photographs: skips what is done, does the rest in any order, gives outcomes in order."""

from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from blur2view.errors import Blur2ViewError
from blur2view.images.video import EndOfVideo, frame_of, frame_time
from blur2view.runs.job import Done, Job, Outcome, Work, failed, photograph_digest, with_contents, written
from blur2view.runs.manifest import Manifest
from blur2view.runs.processes import Engine

Waiting = dict[int, tuple[Job, Outcome] | None]
"""By index, until it is their turn; None for a frame that its video does not have."""


def outcomes(
    work: Work, jobs: Iterable[Job], engine: Engine, manifest: Manifest | None = None, *, sends: bool = False
) -> Done:
    """Yield every job, of consecutive indices, with its outcome in their order.

    Its files are written here, and the manifest has it, as soon as it is done. With ``sends`` photographs are
    read here, too, and sent, as to other machines. OutputError or RunError if the manifest cannot be written,
    or no photograph can be done any more; KeyboardInterrupt after the outcomes that are there.
    """
    waiting: Waiting = {}
    turn = 0
    try:
        with closing(engine(work, _left(jobs, manifest, waiting, sends=sends))) as done:
            for job, outcome in done:
                outcome = written(outcome)
                if manifest is not None and not outcome.error:
                    manifest.append(job, outcome)
                waiting[job.index] = replace(job, content=None, neighbours=()), outcome
                while turn in waiting:
                    if (pair := waiting.pop(turn)) is not None:
                        yield pair
                    turn += 1
    except KeyboardInterrupt:
        yield from filter(None, (waiting[index] for index in sorted(waiting)))
        raise
    yield from filter(None, (waiting[index] for index in sorted(waiting)))


def _left(jobs: Iterable[Job], manifest: Manifest | None, waiting: Waiting, *, sends: bool) -> Iterator[Job]:
    """Yield the jobs that are to be done; the outcomes of the others go where they wait.

    That a video is cut off is said once.
    """
    cut: set[Path] = set()
    for job in jobs:
        try:
            if job.refusal is not None:
                raise job.refusal
            if manifest is not None and (outcome := manifest.find(job)) is not None:
                waiting[job.index] = job, outcome
            else:  # a video is read once, in order
                yield _read(job) if sends or frame_of(job.path) else job
        except EndOfVideo as end:
            said = end.whole or job.path.parent in cut
            waiting[job.index] = None if said else (job, failed(end))
            cut.add(job.path.parent)
        except Blur2ViewError as error:
            waiting[job.index] = job, failed(error)


def _read(job: Job) -> Job:
    """Return a job with its content and those before and after it, of a frame with its place in the video."""
    before = with_contents(one for one in job.neighbours if one.steps < 0)
    read = replace(job, content=job.encoded)
    read = replace(read, neighbours=before + with_contents(one for one in job.neighbours if one.steps > 0))
    if (frame := frame_of(job.path)) is None:
        return read
    digest, time_s = photograph_digest(job.path), frame_time(*frame)
    return replace(read, digest=digest, frame=frame[1], timestamp_s=time_s)
