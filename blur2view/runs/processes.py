"""Jobs done in this process or in several, each of which runs the network in one thread."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import get_context, parent_process

import cv2

from blur2view.runs.job import Done, Job, Outcome, Work, perform

AHEAD = 2  # jobs that wait per process: enough to keep it busy, few enough to hold their contents
Engine = Callable[[Work, Iterator[Job]], Done]
"""Does jobs, each taken when there is room for it, and yields it with its outcome when done, in any order."""


def in_this_process(work: Work, jobs: Iterator[Job]) -> Done:
    """Yield the jobs with their outcomes, one after another."""
    for job in jobs:
        yield job, perform(work, job)


def in_processes(work: Work, jobs: Iterator[Job], *, count: int) -> Done:
    """Yield the jobs with their outcomes, done by several processes, which are killed when it is closed.

    A process that dies (of too little memory, of a damaged file that crashes a decoder) takes the jobs in
    hand with it; each of them is tried once more, alone.
    """
    executor = _executor(count)
    pending: dict[Future[Outcome], Job] = {}
    try:
        while True:
            while len(pending) < AHEAD * count and (job := next(jobs, None)) is not None:
                try:
                    future = executor.submit(perform, work, job)
                except BrokenProcessPool:  # the processes have died meanwhile
                    _end(executor)
                    executor = _executor(count)
                    future = executor.submit(perform, work, job)
                pending[future] = job
            if not pending:
                return
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                job = pending.pop(future)
                lost = isinstance(future.exception(), BrokenProcessPool)
                yield job, _alone(work, job) if lost else future.result()
    finally:
        _end(executor)


def _alone(work: Work, job: Job) -> Outcome:
    """Return the outcome of a job in a process of its own, a failure if that dies."""
    executor = _executor(1)
    try:
        return executor.submit(perform, work, job).result()
    except BrokenProcessPool:
        why = "the process that read it died, perhaps of too little memory; resize it"
        return Outcome(error=f"{job.path}: {why}")
    finally:
        _end(executor)


def _executor(count: int) -> ProcessPoolExecutor:
    """Return processes that start afresh: a fork would copy the threads' locks of the libraries."""
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


def _end(executor: ProcessPoolExecutor) -> None:
    """Kill the processes, which write nothing."""
    processes, results = list((executor._processes or {}).values()), executor._result_queue
    executor.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.kill()
        process.join()
    # without it a thread of the pool waits for ever for the rest of a result (CPython gh-94777)
    results._writer.close()  # type: ignore[attr-defined]


def processes(count: int) -> Engine:
    """Return what does jobs in as many processes, in this one if one is enough."""
    return in_this_process if count == 1 else partial(in_processes, count=count)
