"""Jobs done by a Dask cluster: photographs are sent to its workers, files come back to be written here."""

import asyncio
import logging
import threading
import warnings
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, Queue
from typing import Any

from blur2view.errors import ImageError, RunError
from blur2view.runs.executors import AHEAD
from blur2view.runs.jobs import Done, Job, Outcome, Work, failed, perform

CONNECT_S = 5  # for the scheduler to answer
WORKERS_S = 10  # and then for a worker to be there
LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")  # we say it


class Cluster:
    """A Dask cluster that is asked to do jobs; an `Executor`.

    A worker that is lost costs the time of its photographs: Dask gives them to others. RunError if Dask is
    not installed, no scheduler answers at the address (``tcp://HOST:8786``) or there is no worker.
    """

    def __init__(self, address: str) -> None:
        try:
            import distributed
        except ImportError:
            raise RunError("--dask needs Dask; install it with: pip install 'dask[distributed]'") from None
        self.address, self._dask = address, distributed
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
            with suppress(Exception, asyncio.CancelledError):  # of a scheduler that is gone
                self._client.cancel(list(pending))
            with suppress(Exception, asyncio.CancelledError):
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
        except (Exception, asyncio.CancelledError) as error:  # of a lost scheduler: cancelled
            reason = " ".join(str(error).split()) or type(error).__name__
            raise RunError(
                f"{self.address}: cannot go on ({reason}); see that its scheduler runs and its workers have "
                "this blur2view"
            ) from None
