"""Tools that are given what is not there say so in one line."""

import contextlib
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    "words",
    [
        "datasets.testset out --photos nowhere",
        "evaluation.blur_kinds nowhere",
        "pages a.png --out nowhere/a.webp",
    ],
)
def test_what_is_not_there_is_wrong_usage(
    words: str, tmp_path: Path, call_tool: Callable[[str], None], capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.png", "nowhere" if "--out" in words else "b"):  # a file, no folder
        (tmp_path / name).touch()
    with contextlib.chdir(tmp_path), pytest.raises(SystemExit) as ended:
        call_tool(words)
    assert ended.value.code == 2 and "nowhere" in capsys.readouterr().err.splitlines()[-1]
