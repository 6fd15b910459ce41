"""Worker processes have one thread, and the environment is as before."""

import os

import cv2
import pytest

from tools.processes import THREAD_COUNTS, single_threaded_pool


def threads(_: int) -> tuple[list[str | None], int]:
    """Report the limits that this process sees."""
    return [os.environ.get(name) for name in THREAD_COUNTS], cv2.getNumThreads()


def test_workers_have_one_thread_and_the_environment_is_put_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(THREAD_COUNTS[0], "7")
    monkeypatch.delenv(THREAD_COUNTS[1], raising=False)
    with single_threaded_pool(1) as pool:
        assert pool.map(threads, [0]) == [(["1"] * len(THREAD_COUNTS), 1)]
    assert os.environ[THREAD_COUNTS[0]] == "7" and THREAD_COUNTS[1] not in os.environ
    with pytest.raises(RuntimeError, match="stop"), single_threaded_pool(1):
        raise RuntimeError("stop")
    assert os.environ[THREAD_COUNTS[0]] == "7"
