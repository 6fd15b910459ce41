"""What does jobs: this process, or several, each of which runs the network in one thread."""

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import get_context, parent_process

import cv2

from blur2view.errors import ImageError, RunError
from blur2view.runs.jobs import Done, Executor, Job, Outcome, Work, failed, perform

AHEAD = 2  # jobs that wait per process: enough to keep it busy, few enough to hold their contents


def executor(count: int) -> Executor:
    """Return what does jobs: as many processes, or this one if one is enough."""
    return in_this_process if count == 1 else partial(in_processes, count=count)


def in_this_process(work: Work, jobs: Iterator[Job]) -> Done:
    """Yield the jobs with their outcomes, one after another, done by a thread beside.

    So Ctrl-C is answered at once, and not when a network has run.
    """
    for job in jobs:
        done: list[Outcome | BaseException] = []
        thread = threading.Thread(target=_note, args=(done, work, job), daemon=True)
        thread.start()
        thread.join()
        (outcome,) = done
        if isinstance(outcome, BaseException):
            raise outcome
        yield job, outcome


def _note(done: list[Outcome | BaseException], work: Work, job: Job) -> None:
    """Append what comes of a job, which may be an error of the program."""
    try:
        done.append(perform(work, job))
    except BaseException as error:
        done.append(error)


def in_processes(work: Work, jobs: Iterator[Job], *, count: int) -> Done:
    """Yield the jobs with their outcomes, done by several processes, which are killed when it is closed.

    A process that dies (of too little memory, of a damaged file that crashes a decoder) takes the jobs in
    hand with it; each of them is tried once more, alone. RunError where no process can be started.
    """
    pool = _pool(count)
    pending: dict[Future[Outcome], Job] = {}
    try:
        while True:
            while len(pending) < AHEAD * count and (job := next(jobs, None)) is not None:
                try:
                    future = pool.submit(perform, work, job)
                except BrokenProcessPool:  # the processes have died meanwhile
                    _end(pool)
                    pool = _pool(count)
                    future = pool.submit(perform, work, job)
                pending[future] = job
            if not pending:
                return
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                job = pending.pop(future)
                lost = isinstance(future.exception(), BrokenProcessPool)
                yield job, _alone(work, job) if lost else future.result()
    except OSError as error:
        reason = f"{error.strerror or error}; give it fewer with --jobs"
        raise RunError(f"no processes can be started ({reason})") from None
    finally:
        _end(pool)


def _alone(work: Work, job: Job) -> Outcome:
    """Return the outcome of a job in a process of its own, a failure if that dies."""
    pool = _pool(1)
    try:
        return pool.submit(perform, work, job).result()
    except BrokenProcessPool:
        why = "the process that read it died, perhaps of too little memory; resize it"
        return failed(job, ImageError(f"{job.source}: {why}"))
    finally:
        _end(pool)


def _pool(count: int) -> ProcessPoolExecutor:
    """Return processes that start afresh: a fork would copy the threads' locks of the libraries.

    They import no module of the current folder, whatever it is called.
    """
    os.environ["PYTHONSAFEPATH"], os.environ["PYTHONPATH"] = "1", _search_path()
    try:
        return ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_begin)
    except OSError as error:
        raise RunError(f"no processes can be started ({error.strerror}); add --jobs 1") from None


def _search_path() -> str:
    """Return PYTHONPATH without the current folder, unless that is the program's own."""
    here, root = os.path.realpath("."), os.path.realpath(os.path.join(__file__, "..", "..", ".."))
    found = [os.path.realpath(one or ".") for one in os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    return os.pathsep.join(one for one in found if one == root or one != here)


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


def _end(pool: ProcessPoolExecutor) -> None:
    """Kill the processes, which write nothing."""
    processes, results = list((pool._processes or {}).values()), pool._result_queue
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.kill()
        process.join()
    # without it a thread of the pool waits for ever for the rest of a result (CPython gh-94777)
    results._writer.close()  # type: ignore[attr-defined]
