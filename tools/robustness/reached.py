"""A plugin of pytest that notes which functions of the package each test calls; see `mutations`."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest

ROOT = str(Path(__file__).resolve().parents[2])
PACKAGE = os.path.join(ROOT, "blur2view", "")
_called: set[str] = set()
_functions: dict[str, list[str]] = {}
_seconds: dict[str, float] = {}


def _note(frame: FrameType, event: str, argument: object) -> None:
    """Note the function that is called; its lines are not traced."""
    code = frame.f_code
    if code.co_filename.startswith(PACKAGE):
        name = code.co_qualname.partition(".<")[0]
        _called.add(f"{os.path.relpath(code.co_filename, ROOT)}:{name}()")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Trace a test with its fixtures."""
    _called.clear()
    start = time.perf_counter()
    threading.settrace(_note)
    sys.settrace(_note)
    yield
    sys.settrace(None)
    threading.settrace(None)
    _functions[item.nodeid] = sorted(_called)
    _seconds[item.nodeid] = round(time.perf_counter() - start, 3)


def pytest_sessionfinish() -> None:
    """Write what was noted."""
    Path(os.environ["BLUR2VIEW_REACHED"]).write_text(
        json.dumps({"functions": _functions, "seconds": _seconds})
    )
