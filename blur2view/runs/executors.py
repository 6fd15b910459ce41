"""What does jobs: this process, several, each of which runs the network in one thread, or a Dask cluster."""

import logging
import os
import signal
import threading
import warnings
from collections.abc import Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import get_context, parent_process
from queue import Empty, Queue
from typing import Any

import cv2

from blur2view.errors import ImageError, RunError
from blur2view.runs.jobs import Done, Executor, Job, Outcome, Work, failed, perform

CONNECT_S = 5  # for the scheduler to answer
WORKERS_S = 10  # and then for a worker to be there
LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")  # we say it
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


class Cluster:
    """A Dask cluster that is asked to do jobs; an `Executor`.

    A worker that is lost costs the time of its photographs: Dask gives them to others. RunError if Dask is
    not installed, no scheduler answers at the address (``tcp://HOST:8786``) or there is no worker.
    """

    def __init__(self, address: str) -> None:
        import asyncio  # which takes time to import

        try:
            import distributed
        except ImportError:
            raise RunError("--dask needs Dask; install it with: pip install 'dask[distributed]'") from None
        self.address, self._dask = address, distributed
        self._lost = Exception, asyncio.CancelledError  # of a scheduler that is gone
        for name in LOGGERS:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        self._client = self._connected()
        try:
            self._client.wait_for_workers(1, timeout=WORKERS_S)
        except TimeoutError:
            self._client.close()
            raise RunError(f"{address}: has no worker; start some with: dask worker {address}") from None

    def _connected(self) -> Any:
        """Return a client of the scheduler; RunError if none answers in time, as another program may."""
        answers: Queue[Any] = Queue()

        def connect() -> None:
            try:
                answers.put(self._dask.Client(self.address, timeout=CONNECT_S))
            except BaseException as error:  # of any type, where no scheduler answers
                answers.put(error)

        threading.Thread(target=connect, daemon=True).start()
        try:
            answer = answers.get(timeout=CONNECT_S)
        except Empty:
            answer = TimeoutError(f"in {CONNECT_S} s")
        if isinstance(answer, BaseException):
            reason = " ".join(str(answer).split()) or type(answer).__name__
            raise RunError(f"{self.address}: no Dask scheduler answers ({reason}); is there one?") from None
        return answer

    def __call__(self, work: Work, jobs: Iterator[Job]) -> Done:
        """Yield the jobs, which must have their contents, with their outcomes."""
        pending: dict[Any, Job] = {}
        try:
            while True:
                with self._in_touch():
                    slots = AHEAD * max(sum(self._client.nthreads().values()), 1)
                while len(pending) < slots and (job := next(jobs, None)) is not None:
                    with self._in_touch(), warnings.catch_warnings():
                        warnings.simplefilter("ignore")  # of large arguments; scattered they could be lost
                        future = self._client.submit(perform, work, job, pure=False)
                    pending[future] = job
                if not pending:
                    return
                with self._in_touch():
                    done = self._dask.wait(list(pending), return_when="FIRST_COMPLETED").done
                for future in done:
                    yield pending[future], self._outcome(pending.pop(future), future)
        finally:
            with suppress(*self._lost):
                self._client.cancel(list(pending))
            with suppress(*self._lost):
                self._client.close()

    def _outcome(self, job: Job, future: Any) -> Outcome:
        with self._in_touch():
            try:
                outcome: Outcome = future.result()
            except self._dask.scheduler.KilledWorker:
                why = "every worker that read it died; resize it or give them memory"
                outcome = failed(job, ImageError(f"{job.source}: {why}"))
        return outcome

    @contextmanager
    def _in_touch(self) -> Generator[None]:
        """Raise RunError for whatever keeps the cluster from going on: no module, no scheduler."""
        try:
            yield
        except RunError:
            raise
        except self._lost as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise RunError(
                f"{self.address}: cannot go on ({reason}); see that its scheduler runs and its workers have "
                "this blur2view"
            ) from None
