"""What is printed: summaries on stdout, one line per failure and progress on stderr."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from blur2view.errors import Blur2ViewError

if TYPE_CHECKING:
    from blur2view.results.photograph import Photograph

Say = Callable[..., None]
DONE, FAILED, INTERRUPTED, UNREAD = 0, 1, 130, 141  # exit codes
EXIT_CODES = """
0: done; a photograph without F is a result, with its reason
1: something failed: one line on stderr each, other photographs are done all the same
2: wrong usage
130: interrupted by Ctrl-C: the files of what is done are kept; with -o, --resume does the rest
141: what read the output wants no more of it, as head does; the rest is not done
"""
ERASE = "\r\x1b[K"  # what stands on the last line of a terminal


def printable(text: str) -> str:
    """Return a text on one line in which what a terminal would obey is written as escapes."""
    return "".join(
        mark if mark.isprintable() else mark.encode("unicode_escape").decode("ascii") for mark in text
    )


def complain(error: Blur2ViewError, say: Say = print) -> None:
    """Print one line on stderr."""
    say(f"blur2view: {printable(str(error))}", file=sys.stderr)


def plural(count: int, noun: str) -> str:
    """Return a count with its noun: "1 pair", "2 pairs"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def verdict_line(name: str, one: "Photograph") -> str:
    """Return the one sentence that matters, then, where the camera moved, the configuration's COLMAP name."""
    return f"{printable(name)}: {one.verdict}" + f" [{one.config}]" * one.moved


class Bar:
    """How many photographs are done: the last line of a terminal, below what is printed meanwhile."""

    def __init__(self, count: int) -> None:
        self.count, self.done, self.start_s = count, 0, time.monotonic()
        self.draw()

    def say(self, text: str, file: Any = None) -> None:
        """Print a line above."""
        print(ERASE, end="", file=sys.stderr, flush=True)
        print(text, file=file or sys.stdout, flush=True)
        self.draw()

    def advance(self) -> None:
        """Count one that is done."""
        self.done += 1
        self.draw()

    def draw(self) -> None:
        """Print how many are done, the rate and what is left."""
        seconds = time.monotonic() - self.start_s
        text = f"{self.done} of {plural(self.count, 'photograph')}"
        if self.done and seconds > 0:
            left = round(seconds / self.done * (self.count - self.done))
            text += f", {self.done / seconds:.2g} a second, {left // 60}:{left % 60:02d} left"
        print(ERASE + text, end="", file=sys.stderr, flush=True)


@contextmanager
def progress(count: int) -> Iterator[tuple[Say, Callable[[], None]]]:
    """Yield what prints a line, and what counts one more that is done: on a bar, if a person watches."""
    if count < 2 or not sys.stderr.isatty():
        yield print, lambda: None
        return
    bar = Bar(count)
    try:
        yield bar.say, bar.advance
    finally:
        print(ERASE, end="", file=sys.stderr, flush=True)


@contextmanager
def waiting(text: str) -> Iterator[Callable[[int, int], None]]:
    """Show a person what is waited for, until it is done; yield what shows how many steps of all are."""

    def show(done: int | None = None, count: int | None = None) -> None:
        if sys.stderr.isatty():
            said = "" if done is None else f": {done} of {count}"
            print(f"{ERASE}{printable(text)}{said} ...", end="", file=sys.stderr, flush=True)

    show()
    try:
        yield show
    finally:
        print(ERASE * sys.stderr.isatty(), end="", file=sys.stderr, flush=True)
