"""Tools that are given what is not there say so in one line; their workers have one thread."""

import contextlib
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    "words",
    [
        "datasets.sample nowhere.txt/sample.jpg",
        "datasets.sample sample.jpg --photos nowhere",
        "evaluation.blur_kinds nowhere",
    ],
)
def test_what_is_not_there_is_wrong_usage(
    words: str, tmp_path: Path, call_tool: Callable[[str], None], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "nowhere.txt").touch()  # no folder
    with contextlib.chdir(tmp_path), pytest.raises(SystemExit) as ended:
        call_tool(words)
    assert ended.value.code == 2 and "nowhere" in capsys.readouterr().err.splitlines()[-1]
