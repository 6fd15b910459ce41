"""Processes that are started afresh, leave Ctrl-C to their parent, use one thread, and end with it.

What starts them is imported where one is started: an estimate of one photograph starts none.
"""

import os
import sys
from collections.abc import Callable
from signal import SIG_IGN, SIGINT, signal
from threading import Thread
from typing import TYPE_CHECKING, Any

import cv2

from blur2view.errors import RunError

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing.connection import Connection
    from multiprocessing.context import SpawnContext


def is_child() -> bool:
    """Return whether another process of Python started this one."""
    library = sys.modules.get("multiprocessing")  # which a child has imported
    return library is not None and library.parent_process() is not None


def spawn_context() -> "SpawnContext":
    """Return how processes are started: a fork would copy the threads' locks of the libraries.

    They import no module of the current folder, whatever it is called.
    """
    from multiprocessing import get_context

    os.environ["PYTHONSAFEPATH"] = "1"
    return get_context("spawn")


def not_started(error: OSError) -> RunError:
    """Return the error of processes that the system does not start."""
    remedy = "free some memory, or ask for fewer with --jobs"
    return RunError(f"processes cannot be started ({error.strerror or error}); {remedy}")


def processes(
    count: int,
    prepare: Callable[..., None] | None = None,
    args: tuple[Any, ...] = (),
    *,
    stop: "Connection | None" = None,
) -> "ProcessPoolExecutor":
    """Return an executor of processes, each of which is prepared by ``prepare(*args)``.

    They end when the other end of the pipe ``stop`` is closed, whatever they are doing. (Who sets an event
    waits for ever for a process that was killed while it waited for the event.)
    """
    from concurrent.futures import ProcessPoolExecutor

    return ProcessPoolExecutor(
        count, mp_context=spawn_context(), initializer=_begin, initargs=(stop, prepare, args)
    )


def _begin(stop: "Connection | None", prepare: Callable[..., None] | None, args: tuple[Any, ...]) -> None:
    """Prepare a process."""
    follow_parent(stop)
    cv2.setNumThreads(1)
    if prepare is not None:
        prepare(*args)


def follow_parent(stop: "Connection | None" = None) -> None:
    """Leave Ctrl-C to the parent of this process, and end with it, or when the pipe ``stop`` is closed."""
    signal(SIGINT, SIG_IGN)
    Thread(target=_end_with_parent, args=(stop,), daemon=True).start()


def _end_with_parent(stop: "Connection | None") -> None:
    """End this process when it is told to, or its parent is gone: nobody would take its results."""
    from multiprocessing import connection, parent_process

    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel] if stop is None else [parent.sentinel, stop])
        os._exit(1)
