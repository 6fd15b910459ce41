"""What does the work: processes of this machine (`blur2view.processes`) or workers of a Dask cluster."""

import logging
import os
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import Executor, Future, wait
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from blur2view.errors import RunError
from blur2view.images.image import Content

CONNECT_S, WORKERS_S = 5, 10  # seconds to wait for a scheduler's answer, and then for a worker (bounds)
ANSWER_S = 2.0  # between looks whether the workers of a cluster are there
LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")
"""Loggers of Dask that are silenced: its errors are printed as lines of blur2view."""
T = TypeVar("T")


class Shared:
    """The content of a file in memory, which other processes read without a pipe if the system allows it."""

    def __init__(self, content: Content) -> None:
        self._content: Content | None = content
        self._where = "", content.shape if isinstance(content, np.ndarray) else None
        if hasattr(os, "memfd_create") and os.path.isdir(f"/proc/{os.getpid()}/fd"):
            with suppress(OSError):
                number = os.memfd_create("blur2view")
                weakref.finalize(self, os.close, number)
                with open(number, "wb", closefd=False) as file:
                    file.write(content if isinstance(content, bytes) else content.data)
                self._where = f"/proc/{os.getpid()}/fd/{number}", self._where[1]
                self._content = None

    def read(self) -> Content:
        """Return the content."""
        return _read_whole(*self._where) if self._content is None else self._content

    def __reduce__(self) -> tuple[Callable[..., Content], tuple[object, ...]]:
        """Return how another process makes the content of it."""
        return (_read_whole, self._where) if self._content is None else (as_it_is, (self._content,))


def _read_whole(path: str, shape: tuple[int, ...] | None) -> Content:
    return Path(path).read_bytes() if shape is None else np.fromfile(path, np.uint8).reshape(shape)


def as_it_is(content: Content) -> Content:
    """Return a content for a thread, which shares it."""
    return content


class Restarted:
    """An executor that is started again after its processes are lost.

    A process dies of too little memory, or of a damaged file that crashes a decoder; with it the jobs in hand
    are ``lost``. ``share`` makes of a content what goes to a process; ``alive`` raises an error if nobody is
    there to answer.
    """

    def __init__(
        self,
        start: Callable[[], Executor],
        lost: type[Exception],
        share: Callable[[Content], Any],
        alive: Callable[[], None] = lambda: None,
    ) -> None:
        self.start, self.lost, self.share, self.alive = start, lost, share, alive
        self.executor = start()

    def submit(self, function: Callable[..., T], *words: object) -> "Future[T]":
        """Begin a call of a function."""
        try:
            return self.executor.submit(function, *words)
        except self.lost:  # meanwhile
            self.executor = self.start()
            return self.executor.submit(function, *words)

    def result(self, future: "Future[T]") -> T:
        """Return the result of a call."""
        while not wait([future], ANSWER_S).done:
            self.alive()
        return future.result()


def connected(address: str) -> tuple[Any, type[Exception]]:
    """Return a client of a Dask scheduler, and the error of a job that killed its workers.

    A scheduler that does not answer in time is RunError, because another program at the address may wait for
    ever.
    """
    try:
        import distributed
    except ImportError:
        raise RunError("--dask needs Dask; install it with: pip install 'dask[distributed]'") from None
    for name in LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    answer = Future[Any]()

    def connect() -> None:
        try:
            answer.set_result(distributed.Client(address, timeout=CONNECT_S))
        except BaseException as error:  # of any type, where no scheduler answers
            answer.set_exception(OSError(" ".join(str(error).split()) or type(error).__name__))

    threading.Thread(target=connect, daemon=True).start()
    try:
        client = answer.result(CONNECT_S)
    except (OSError, TimeoutError) as error:
        reason = str(error) or f"in {CONNECT_S} s"
        raise RunError(
            f"{address}: no Dask scheduler answers ({reason}); check the address, or start a dask scheduler"
        ) from None
    wait_for_worker(client, address)
    return client, distributed.scheduler.KilledWorker


def wait_for_worker(client: Any, address: str) -> None:
    """Wait until a scheduler has a worker; raises RunError if none comes."""
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError:
        raise RunError(
            f"{address}: the Dask scheduler has no worker; start one with: dask worker {address}"
        ) from None
