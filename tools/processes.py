"""Worker processes with one thread each, so that studies are fair to every library and fill all cores."""

import multiprocessing
import multiprocessing.pool
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import cv2

T = TypeVar("T")
R = TypeVar("R")
THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def single_threaded_pool(processes: int) -> Iterator[multiprocessing.pool.Pool]:
    """Yield a pool of fresh processes in which numpy and OpenCV use one thread.

    Libraries read their limits when they are loaded: the environment is set for the workers, and stays so.
    """
    os.environ.update(dict.fromkeys(THREAD_COUNTS, "1"))
    with multiprocessing.get_context("spawn").Pool(processes, cv2.setNumThreads, (1,)) as pool:
        yield pool
        pool.close()  # let the workers end by themselves: pycolmap prints a trace when it is killed
        pool.join()


def mapped(work: Callable[[T], R], items: Iterable[T], processes: int, chunk: int = 1) -> list[R]:
    """Return the results of all items in order, by so many processes of one thread, or by this one."""
    if processes == 1:
        return [work(item) for item in items]
    with single_threaded_pool(processes) as pool:
        return pool.map(work, items, chunksize=chunk)
