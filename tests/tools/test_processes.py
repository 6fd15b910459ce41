"""Worker processes have one thread."""

import os

import cv2
import pytest

from tools.processes import THREAD_COUNTS, single_threaded_pool


def threads(_: int) -> tuple[list[str | None], int]:
    """Report the limits that this process sees."""
    return [os.environ.get(name) for name in THREAD_COUNTS], cv2.getNumThreads()


def test_workers_have_one_thread() -> None:
    with single_threaded_pool(1) as pool:
        assert pool.map(threads, [0]) == [(["1"] * len(THREAD_COUNTS), 1)]
    with pytest.raises(RuntimeError, match="stop"), single_threaded_pool(1):
        raise RuntimeError("stop")
