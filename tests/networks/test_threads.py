"""Threads of BLAS and OpenCV beside those of a network."""

import cv2
import pytest
from threadpoolctl import threadpool_info

from blur2view.networks.threads import one_thread


def threads() -> list[int]:
    """Return how many threads OpenCV and BLAS use."""
    return [
        cv2.getNumThreads(),
        *(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"),
    ]


def test_threads_are_as_before_after_the_outermost_block_and_after_an_error() -> None:
    before = threads()
    with pytest.raises(KeyError), one_thread:
        with one_thread:
            pass
        assert set(threads()) == {1}
        raise KeyError
    assert threads() == before
