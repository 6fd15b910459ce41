"""Worker processes of one thread each: a study fills all cores and gives every library the same."""

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

import cv2

T = TypeVar("T")
R = TypeVar("R")
THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def mapped(work: Callable[[T], R], items: Iterable[T], processes: int, chunk: int = 1) -> Iterator[R]:
    """Yield the results of all items in order, by ``processes`` processes of one thread each, or by this one.

    Libraries read their limits when they are loaded, so the environment is set, and stays so.
    """
    if processes == 1:
        yield from map(work, items)
        return
    os.environ.update(dict.fromkeys(THREAD_COUNTS, "1"))
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, fresh, cv2.setNumThreads, (1,)) as pool:
        yield from pool.map(work, items, chunksize=chunk)
