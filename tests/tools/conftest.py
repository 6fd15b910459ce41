"""Running a tool's command line in this process."""

from collections.abc import Callable
from importlib import import_module

import pytest

from tools.command import run


@pytest.fixture
def call_tool(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Return a function that runs ``python -m tools.WORDS``."""

    def call(words: str) -> None:
        name, *arguments = words.split()
        monkeypatch.setattr("sys.argv", [name, *arguments])
        run(import_module(f"tools.{name}").main)

    return call
