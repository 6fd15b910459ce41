"""Progress: what a person sees of a long step, and what a file holds of it."""

import linecache
import re
import sys
import threading
import time
from functools import partial
from itertools import count
from types import FrameType
from typing import Any

import pytest

from blur2view.cli import terminal
from blur2view.cli.terminal import complain, say, waiting
from blur2view.errors import Blur2ViewError


@pytest.fixture
def quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw what takes longer than a hundredth of a second."""
    for pause in ("FIRST_S", "REDRAW_S", "LINE_S"):
        monkeypatch.setattr(terminal, pause, 0.01)


def until_drawn(capsys: pytest.CaptureFixture[str], pattern: str) -> str:
    """Wait until stderr holds a pattern; return it."""
    end, drawn = time.monotonic() + 300, ""
    while not re.search(pattern, drawn) and time.monotonic() < end:
        time.sleep(0.01)
        drawn += capsys.readouterr().err
    return drawn


@pytest.mark.usefixtures("quickly")
def test_a_person_sees_rate_and_time_left_and_lines_above(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with waiting("frames") as show:
        assert re.search(r"\rframes \.\.\. \d\d:\d\d", until_drawn(capsys, r"frames .*\d\d:\d\d"))
        show(1, 4)
        assert re.search(
            r"frames:  25%\|.*\| 1 of 4, .*/s, .* left", until_drawn(capsys, "1 of 4, .*/s, .* left")
        )
        say("a line")
        complain(Blur2ViewError("a failure"))
        printed = capsys.readouterr()
        assert printed.out == "a line\n" and re.search("\r *\rblur2view: a failure\n\r", printed.err)
    with waiting("the next step"):
        until_drawn(capsys, "the next step")
    assert re.search("\r *\r$", capsys.readouterr().err)  # nothing stays


@pytest.mark.usefixtures("quickly")
def test_a_file_gets_plain_lines(capsys: pytest.CaptureFixture[str]) -> None:
    step = terminal.Step("frames")
    step.began -= 100
    step.note(3, 4)
    drawing = threading.Thread(target=step.draw)
    drawing.start()
    drawn = until_drawn(capsys, "left\n")
    step.ended.set()
    drawing.join()
    assert re.fullmatch(r"(blur2view: frames: 3 of 4, 0\.0\d/s, \d\d:\d\d left\n)+", drawn)


def test_what_is_short_or_hidden_shows_nothing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with waiting("frames") as show:
        show(1, 4)
    monkeypatch.setattr(terminal, "LINE_S", 0.001)
    with waiting("frames", hidden=True):
        time.sleep(0.05)
    assert capsys.readouterr().err == ""


def others_may_draw() -> bool:
    """Return whether another thread gets the lock of the terminal."""
    taken = list[bool]()

    def take() -> None:
        taken.append(terminal.DRAWING.acquire(blocking=False))
        if taken[0]:
            terminal.DRAWING.release()

    other = threading.Thread(target=take)
    other.start()
    other.join()
    return taken[0]


@pytest.mark.usefixtures("capsys")
def test_ctrl_c_at_any_line_of_printing_leaves_the_terminal_to_the_bars_thread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bar = terminal.Step("frames")._bar(terminal=True)
    monkeypatch.setattr(terminal, "BARS", [bar])

    def presses(line: int) -> bool:
        """Print, and press Ctrl-C at the given line that runs meanwhile; return whether there is one."""
        left = iter(range(line))

        def press(frame: FrameType, event: str, value: object) -> Any:
            words = linecache.getline(frame.f_code.co_filename, frame.f_lineno).strip()
            # Python calls the lock's own function here, and answers no signal before and after it
            if event == "line" and words != "with DRAWING:" and next(left, None) is None:
                raise KeyboardInterrupt
            return press

        sys.settrace(press)
        try:
            say("a line")
        except KeyboardInterrupt:  # whose traceback holds what was in hand
            assert others_may_draw(), f"line {line} of printing"
            return True
        finally:
            sys.settrace(None)
        return False

    assert sum(iter(partial(next, map(presses, count())), False)) > 20
    bar.close()
