"""Threads of libraries that stand in each other's way."""

from contextlib import ContextDecorator
from threading import Lock

import cv2
from threadpoolctl import threadpool_limits


class OneThread(ContextDecorator):
    """Lets BLAS and OpenCV use one thread in a block: others spin, and networks take 3 times as long."""

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0

    def __enter__(self) -> None:
        """Enter."""
        with self._lock:
            if not self._inside:
                self._of_opencv = cv2.getNumThreads()
                cv2.setNumThreads(1)
                self._of_blas = threadpool_limits(limits=1, user_api="blas")
            self._inside += 1

    def __exit__(self, *error: object) -> None:
        """Restore what was before, with the last block that ends."""
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._of_blas.restore_original_limits()
                cv2.setNumThreads(self._of_opencv)


one_thread = OneThread()
