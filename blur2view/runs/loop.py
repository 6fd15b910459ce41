"""One loop over jobs: keeps what is done, does the rest in any order, gives the outcomes in order."""

import errno
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from blur2view.errors import Blur2ViewError, RunError
from blur2view.images.video import EndOfVideo, frame_time
from blur2view.output_files import unwritable, write_files
from blur2view.runs.executors import Executor
from blur2view.runs.job import Done, Job, Outcome, Work, content_of, failed, identified, with_contents

FULL = {
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EROFS,
    errno.EFBIG,
}  # the next photograph's files would not fit either
Waiting = dict[int, tuple[Job, Outcome] | None]
"""By index, until it is their turn; None for a frame that its video does not have."""
Find = Callable[[Job], Outcome | None]
Keep = Callable[[Job, Outcome], None]


def outcomes(
    work: Work,
    jobs: Iterable[Job],
    executor: Executor,
    *,
    find: Find = lambda job: None,
    keep: Keep = lambda job, outcome: None,
    sends: bool = False,
) -> Done:
    """Yield every job, of consecutive indices, with its outcome in their order.

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
    keep : callable
        Notes what was done, as soon as its files are written.
    sends : bool
        Whether photographs are read here and sent, as to other machines.

    Raises
    ------
    OutputError, RunError
        If nothing can be noted, or no photograph can be done any more.
    KeyboardInterrupt
        After the outcomes that are there.
    """
    waiting: Waiting = {}
    turn = 0
    try:
        with closing(executor(work, _left(jobs, find, waiting, sends=sends))) as done:
            for job, outcome in done:
                outcome = _written(job, outcome)
                if not outcome.error:
                    keep(job, outcome)
                waiting[job.index] = replace(job, content=None, neighbours=()), outcome
                while turn in waiting:
                    if (pair := waiting.pop(turn)) is not None:
                        yield pair
                    turn += 1
    except KeyboardInterrupt:
        yield from filter(None, (waiting[index] for index in sorted(waiting)))
        raise
    yield from filter(None, (waiting[index] for index in sorted(waiting)))


def _written(job: Job, outcome: Outcome) -> Outcome:
    """Return an outcome whose files are written; it is a failure if they cannot be."""
    try:
        if outcome.files:
            write_files(outcome.files)
    except OSError as error:
        refusal = unwritable(next(iter(outcome.files)).parent, error)
        return failed(job, RunError(str(refusal)) if error.errno in FULL else refusal)
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
    before = with_contents(one for one in job.neighbours if one.steps < 0)
    read = replace(job, content=content_of(job))
    after = with_contents(one for one in job.neighbours if one.steps > 0)
    read = replace(identified(read), neighbours=before + after)
    source = job.source
    if source.frame is None:
        return read
    return replace(read, source=replace(source, time_s=frame_time(source.path, source.frame)))
