"""Jobs in order, done by one process, several processes or a Dask cluster."""

import errno
import hashlib
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from typing import Any

from blur2view.cli.batch.executors import Restarted, Shared, as_it_is, connected, wait_for_worker
from blur2view.cli.batch.job import Done, Find, Job, Look, Outcome, Work, failed
from blur2view.cli.batch.reading import forget, read_ahead
from blur2view.errors import Blur2ViewError, ImageError, OutputError, RunError, within_memory
from blur2view.exposure.sequence import Features, Series
from blur2view.images.image import Content
from blur2view.images.inputs import Source
from blur2view.output import NO_ROOM, write_beside
from blur2view.processes import not_started, processes

AHEAD = 3  # bound; jobs begun per process: enough to keep it busy, few enough to hold their contents
DISK_FULL = NO_ROOM | {errno.EROFS}
"""Errors after which the files of the next photograph could not be written either."""


def in_processes(work: Work, jobs: Iterable[Job], find: Find, look: Look, *, count: int) -> Done:
    """Yield jobs with their outcomes, done by ``count`` processes, or by a thread if one is enough.

    The main thread matches neighbours and nothing else, so that Ctrl-C is answered at once; another one reads
    ahead. RunError where no process can be started.
    """
    start: Callable[[], Executor] = partial(processes, count) if count > 1 else partial(ThreadPoolExecutor, 1)
    slots = AHEAD * count if count > 1 else 1
    try:
        executor = Restarted(start, BrokenExecutor, Shared if count > 1 else as_it_is)
        yield from _in_order(work, jobs, find, look, executor, lambda: slots)
    except OSError as error:
        raise not_started(error) from None


def in_cluster(work: Work, jobs: Iterable[Job], find: Find, look: Look, *, address: str) -> Done:
    """Yield jobs with their outcomes, done by the workers of a Dask cluster (``tcp://HOST:8786``).

    A worker that is lost costs the time of its photographs: Dask gives them to others. RunError if Dask is
    not installed, no scheduler answers, there is no worker for some seconds, or whatever else keeps it from
    going on.
    """
    client, killed = connected(address)

    def alive() -> None:
        if not client.nthreads():
            wait_for_worker(client, address)

    try:
        executor = Restarted(partial(client.get_executor, pure=False), killed, as_it_is, alive)
        yield from _in_order(
            work, jobs, find, look, executor, lambda: AHEAD * max(sum(client.nthreads().values()), 1)
        )
    except Blur2ViewError:
        raise
    except Exception as error:  # of any type: the scheduler is gone, or a worker lacks a module
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RunError(
            f"{address}: cannot go on ({reason}); check that its scheduler runs and that its workers have "
            "this blur2view"
        ) from None
    finally:
        threading.Thread(target=client.close, daemon=True).start()  # it may wait in vain


def _in_order(
    work: Work, jobs: Iterable[Job], find: Find, look: Look, executor: Restarted, slots: Callable[[], int]
) -> Done:
    """Yield jobs in order with their outcomes, files written, done by an executor.

    At most ``slots()`` jobs wait for the features of their neighbours, and as many are begun. Those in hand
    when a process dies are tried once more, alone. A video that is cut off fails once, not with every frame.
    OutputError on a full disk.
    """
    waiting, pending = deque[tuple[Job, Outcome | None]](), deque[tuple[Job, Future[Outcome]]]()
    features = _Features(look, executor)
    series = Series(features.of)

    def begin() -> None:
        job, outcome = waiting.popleft()
        if outcome is None:
            job = replace(job, matches=series.around(job.source, job.neighbours))
            features.drop(job)
            shared = replace(job, content=None if job.content is None else executor.share(job.content))
            pending.append((shared, executor.submit(_perform, work, shared)))
        else:
            future = Future[Outcome]()
            future.set_result(outcome)
            pending.append((job, future))

    def oldest() -> tuple[Job, Outcome]:
        job, future = pending[0]
        try:
            outcome = executor.result(future)
        except executor.lost:
            outcome = _alone(work, job)
        pending.popleft()
        return replace(job, matches={}), _written(job, outcome)

    try:
        with closing(read_ahead(jobs, find)) as begun:
            for job, outcome in begun:
                features.begin(job.beside)
                waiting.append((replace(job, beside={}), outcome))
                while len(waiting) > (slots() if job.neighbours else 0):
                    begin()
                del job
                while len(pending) >= slots():
                    yield oldest()
        while waiting:
            begin()
        while pending:
            yield oldest()
    finally:
        for _, future in pending:
            future.cancel()
        executor.executor.shutdown(wait=not pending and not waiting)
        forget()


class _Features:
    """Features of photographs that neighbours ask for, each found once, ahead of the jobs."""

    def __init__(self, look: Look, executor: Restarted) -> None:
        self._look, self._executor = look, executor
        self._found = dict[Source, tuple[Any, Future[Features | None]]]()  # with what was sent

    def begin(self, contents: Mapping[Source, Content]) -> None:
        """Begin to find the features of photographs."""
        for source, content in contents.items():
            if source not in self._found:
                shared = self._executor.share(content)
                future = self._executor.submit(_looked, self._look, source, shared)
                self._found[source] = shared, future

    def of(self, source: Source) -> Features | None:
        """Return the features of a photograph, None if it cannot be read."""
        if source not in self._found:
            return None
        shared, future = self._found[source]
        try:
            return self._executor.result(future)
        except self._executor.lost:
            with processes(1) as pool, suppress(BrokenExecutor):
                return pool.submit(_looked, self._look, source, shared).result()
            return None

    def drop(self, job: Job) -> None:
        """Forget the features of a job and of the jobs before it, because they are matched."""
        for source in (job.source, *(near for steps, near in job.neighbours if steps < 0)):
            self._found.pop(source, None)


def _looked(look: Look, source: Source, content: Content) -> Features | None:
    """Return the features of a photograph, None if it cannot be read, which costs a line of its own."""
    with suppress(Blur2ViewError), within_memory(source.path):
        return look(source, content)
    return None


def _perform(work: Work, job: Job) -> Outcome:
    """Return the outcome of one photograph, its files unwritten."""
    try:
        with within_memory(job.source.path):
            return work(job)
    except Blur2ViewError as error:
        return failed(job.name, error)


def _written(job: Job, outcome: Outcome) -> Outcome:
    """Return an outcome whose files are written, or a failure; OutputError on a full disk."""
    if not outcome.contents:
        return outcome
    record = replace(outcome.record, files_sha256=combined_digest(outcome.contents))
    document = (record.to_json() + "\n").encode()
    try:
        write_beside(dict(zip(job.files, [*outcome.contents, document], strict=True)))
    except OutputError as error:
        if isinstance(error.__cause__, OSError) and error.__cause__.errno in DISK_FULL:
            raise
        return failed(job.name, OutputError(f"{job.name}: {error}"))
    return replace(outcome, record=record, contents=())


def combined_digest(contents: Iterable[bytes]) -> str:
    """Return one SHA-256 of the sizes and contents of files, in the order of writing."""
    digest = hashlib.sha256()
    for content in contents:
        digest.update(b"%d " % len(content) + content)
    return digest.hexdigest()


def _alone(work: Work, job: Job) -> Outcome:
    """Return the outcome of a job in a process of its own, a failure if that dies."""
    with processes(1) as pool:
        try:
            return pool.submit(_perform, work, job).result()
        except BrokenExecutor:
            why = "the process that read it died, perhaps because of too little memory; resize it"
            return failed(job.name, ImageError(f"{job.source}: {why}"))
