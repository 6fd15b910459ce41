"""Tools: a wrong path is one line; a page keeps the words around its marks."""

import contextlib
from collections.abc import Callable
from pathlib import Path

import pytest

from tools.command import publish


@pytest.mark.parametrize(
    "words",
    [
        "datasets.testset out --photos nowhere",
        "evaluation.blur_kinds nowhere",
        "evaluation.benchmark --out a.png/nowhere.md",
    ],
)
def test_what_is_not_there_is_wrong_usage(
    words: str, tmp_path: Path, call_tool: Callable[[str], None], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.png").touch()  # a file, no folder
    with contextlib.chdir(tmp_path), pytest.raises(SystemExit) as ended:
        call_tool(words)
    assert ended.value.code == 2 and "nowhere" in capsys.readouterr().err.splitlines()[-1]


def test_a_page_is_written_whole_or_between_its_marks(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    publish(page, "one", ["two", "three"])
    made = page.read_text()
    assert made.startswith("one\n\ntwo\nthree\n\nMade by `python -m ")
    page.write_text("before\n<!-- made -->\nold\n<!-- end -->\nafter\n")
    publish(page, "one", ["two", "three"])
    assert page.read_text() == f"before\n<!-- made -->\n{made}<!-- end -->\nafter\n"
