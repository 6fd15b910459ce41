"""Tools that are given what is not there say so in one line; their workers have one thread."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from tools.processes import THREAD_COUNTS, single_threaded_pool


@pytest.mark.parametrize(
    "words",
    [
        "datasets.sample nowhere.txt/sample.jpg",
        "datasets.sample sample.jpg --photos nowhere",
        "evaluation.even_blur nowhere",
    ],
)
def test_what_is_not_there_is_wrong_usage(
    words: str, tmp_path: Path, call_tool: Callable[[str], None], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "nowhere.txt").touch()  # no folder
    with contextlib.chdir(tmp_path), pytest.raises(SystemExit) as ended:
        call_tool(words)
    assert ended.value.code == 2 and "nowhere" in capsys.readouterr().err.splitlines()[-1]


def threads(_: int) -> tuple[list[str | None], int]:
    """Report the limits that this process sees."""
    return [os.environ.get(name) for name in THREAD_COUNTS], cv2.getNumThreads()


def test_workers_have_one_thread() -> None:
    with single_threaded_pool(1) as pool:
        assert pool.map(threads, [0]) == [(["1"] * len(THREAD_COUNTS), 1)]
    with pytest.raises(RuntimeError, match="stop"), single_threaded_pool(1):
        raise RuntimeError("stop")
