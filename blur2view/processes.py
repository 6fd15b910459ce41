"""Processes that are started afresh, leave Ctrl-C to their parent, use one thread, and end with it."""

import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context, parent_process
from multiprocessing.context import SpawnContext
from signal import SIG_IGN, SIGINT, signal
from threading import Thread
from typing import Any

import cv2

WAIT_S = 0.5  # between looks of a process whether its parent is there, where it may be told to end


def spawn_context() -> SpawnContext:
    """Return how processes are started: a fork would copy the threads' locks of the libraries.

    They import no module of the current folder, whatever it is called.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    return get_context("spawn")


def processes(
    count: int, prepare: Callable[..., None] | None = None, given: tuple[Any, ...] = (), *, stop: Any = None
) -> ProcessPoolExecutor:
    """Return an executor of processes, each of which is prepared by ``prepare(*given)``.

    They end when ``stop`` is set, an event of `spawn_context`, whatever they are doing.
    """
    return ProcessPoolExecutor(
        count, mp_context=spawn_context(), initializer=_begin, initargs=(stop, prepare, given)
    )


def _begin(stop: Any, prepare: Callable[..., None] | None, given: tuple[Any, ...]) -> None:
    """Prepare a process."""
    follow_parent(stop)
    cv2.setNumThreads(1)
    if prepare is not None:
        prepare(*given)


def follow_parent(stop: Any = None) -> None:
    """Leave Ctrl-C to the parent of this process, and end with it, or when the event ``stop`` is set."""
    signal(SIGINT, SIG_IGN)
    Thread(target=_end_with_parent, args=(stop,), daemon=True).start()


def _end_with_parent(stop: Any) -> None:
    """End this process when it is told to, or its parent is gone: nobody would take its results."""
    parent = parent_process()
    if stop is not None:
        while not stop.wait(WAIT_S) and parent is not None and parent.is_alive():
            pass
    elif parent is not None:
        parent.join()
    else:
        return
    os._exit(1)
