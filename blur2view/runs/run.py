"""A run over many photographs: skips what is done, does the rest in any order, gives outcomes in order."""

from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from blur2view.errors import Blur2ViewError
from blur2view.photographs.video import EndOfVideo, frame_of, frame_time
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
        yield from (pair for _, pair in sorted(waiting.items()) if pair is not None)
        raise
    yield from (pair for _, pair in sorted(waiting.items()) if pair is not None)


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
            elif (frame := frame_of(job.path)) is not None:  # a video is read once, in order
                yield _read_frame(job, *frame)
            elif sends:
                yield replace(job, content=job.encoded, neighbours=with_contents(job.neighbours))
            else:
                yield job
        except EndOfVideo as end:
            said = end.whole or job.path.parent in cut
            waiting[job.index] = None if said else (job, failed(end))
            cut.add(job.path.parent)
        except Blur2ViewError as error:
            waiting[job.index] = job, failed(error)


def _read_frame(job: Job, video: Path, number: int) -> Job:
    """Return the job of a frame with what is read of its video, in order: before it, itself, after it."""
    before = with_contents(one for one in job.neighbours if one.steps < 0)
    read = replace(job, content=job.encoded, digest=photograph_digest(job.path))
    after = with_contents(one for one in job.neighbours if one.steps > 0)
    time_s = frame_time(video, number)
    return replace(read, frame=number, timestamp_s=time_s, neighbours=before + after)
