"""What does jobs: this process, several, each of which runs the network in one thread, or a Dask cluster.

All of them have the interface of `concurrent.futures`.
"""

import logging
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any

import cv2

from blur2view.errors import Blur2ViewError, ImageError, RunError
from blur2view.images.video import EndOfVideo
from blur2view.runs.jobs import Find, Job, Outcome, Work, begin, failed, perform, written

CONNECT_S = 5  # for the scheduler to answer
WORKERS_S = 10  # and then for a worker to be there
LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")  # we say it
AHEAD = 3  # jobs begun per process: enough to keep it busy, few enough to hold their contents
Done = Generator[tuple[Job, Outcome]]


def in_processes(work: Work, jobs: Iterable[Job], find: Find, *, count: int) -> Done:
    """Yield jobs with their outcomes, done by as many processes, or by a thread if one is enough.

    So Ctrl-C is answered at once, and not when a network has run. RunError where no process can be started.
    """
    start, slots = (
        (partial(_pool, count), AHEAD * count) if count > 1 else (partial(ThreadPoolExecutor, 1), 1)
    )
    try:
        yield from _in_order(work, jobs, find, start, lambda: slots)
    except OSError as error:
        reason = f"{error.strerror or error}; give it fewer with --jobs"
        raise RunError(f"no processes can be started ({reason})") from None


def in_cluster(work: Work, jobs: Iterable[Job], find: Find, *, address: str) -> Done:
    """Yield jobs with their outcomes, done by the workers of a Dask cluster (``tcp://HOST:8786``).

    A worker that is lost costs the time of its photographs: Dask gives them to others. RunError if Dask is
    not installed, no scheduler answers, there is no worker, or whatever else keeps it from going on.
    """
    client, killed = _connected(address)
    start = partial(client.get_executor, pure=False)
    try:
        yield from _in_order(
            work, jobs, find, start, lambda: AHEAD * max(sum(client.nthreads().values()), 1), killed
        )
    except Blur2ViewError:
        raise
    except Exception as error:  # of any type, as the scheduler is gone, or a worker lacks a module
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RunError(
            f"{address}: cannot go on ({reason}); see that its scheduler runs and its workers have this "
            "blur2view"
        ) from None
    finally:
        threading.Thread(target=client.close, daemon=True).start()  # it may wait for a scheduler that is gone


def _in_order(
    work: Work,
    jobs: Iterable[Job],
    find: Find,
    start: Callable[[], Executor],
    slots: Callable[[], int],
    lost: type[Exception] = BrokenProcessPool,
) -> Done:
    """Yield jobs in order with their outcomes, files written, done by the executor that ``start`` returns.

    As many as there are ``slots`` are begun at a time; ``find`` returns the outcome of what an earlier call
    did. A process that dies (of too little memory, of a damaged file that crashes a decoder) is ``lost`` with
    the jobs in hand; each is tried once more, alone. That a video is cut off is said once. OutputError on a
    full disk.
    """
    executor, pending, cut = start(), deque[tuple[Job, Outcome | Future[Outcome]]](), set[Path]()

    def oldest() -> tuple[Job, Outcome]:
        job, outcome = pending[0]
        if isinstance(outcome, Future):
            try:
                outcome = outcome.result()
            except lost:
                outcome = _alone(work, job)
        pending.popleft()
        return replace(job, contents={}), written(outcome)

    try:
        for job in jobs:
            outcome: Outcome | Future[Outcome] | None
            try:
                job, outcome = begin(job, find)
            except EndOfVideo as end:
                if end.whole or job.source.path in cut:
                    continue
                cut.add(job.source.path)
                outcome = failed(job.name, end)
            if outcome is None:
                try:
                    outcome = executor.submit(perform, work, job)
                except lost:  # meanwhile
                    executor = start()
                    outcome = executor.submit(perform, work, job)
            pending.append((job, outcome))
            while len(pending) >= slots():
                yield oldest()
        while pending:
            yield oldest()
    finally:
        for _, outcome in pending:
            if isinstance(outcome, Future):
                outcome.cancel()
        executor.shutdown(wait=False)


def _alone(work: Work, job: Job) -> Outcome:
    """Return the outcome of a job in a process of its own, a failure if that dies."""
    with _pool(1) as pool:
        try:
            return pool.submit(perform, work, job).result()
        except BrokenProcessPool:
            why = "the process that read it died, perhaps of too little memory; resize it"
            return failed(job.name, ImageError(f"{job.source}: {why}"))


def _pool(count: int) -> ProcessPoolExecutor:
    """Return processes that start afresh: a fork would copy the threads' locks of the libraries.

    They import no module of the current folder, whatever it is called.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    return ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_begin)


def _begin() -> None:
    """Prepare a process: it ends with its parent, leaves Ctrl-C to it and uses one thread."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    cv2.setNumThreads(1)


def _end_with_parent() -> None:
    """End this process where the parent is killed: nobody would take its results."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _connected(address: str) -> tuple[Any, type[Exception]]:
    """Return a client of a Dask scheduler, and the error of a job that killed its workers.

    A scheduler that does not answer in time is RunError, as another program at the address may wait for ever.
    """
    try:
        import distributed
    except ImportError:
        raise RunError("--dask needs Dask; install it with: pip install 'dask[distributed]'") from None
    for name in LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    answers: list[Any] = []

    def connect() -> None:
        try:
            answers.append(distributed.Client(address, timeout=CONNECT_S))
        except BaseException as error:  # of any type, where no scheduler answers
            answers.append(error)

    thread = threading.Thread(target=connect, daemon=True)
    thread.start()
    thread.join(CONNECT_S)
    client = answers[0] if answers else TimeoutError(f"in {CONNECT_S} s")
    if isinstance(client, BaseException):
        reason = " ".join(str(client).split()) or type(client).__name__
        raise RunError(f"{address}: no Dask scheduler answers ({reason}); is there one?")
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError:
        raise RunError(f"{address}: has no worker; start some with: dask worker {address}") from None
    return client, distributed.scheduler.KilledWorker
