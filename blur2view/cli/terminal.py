"""What is printed: summaries on stdout, one line per failure and progress on stderr."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from blur2view.errors import Blur2ViewError

if TYPE_CHECKING:
    from blur2view.results.photograph import Photograph

DONE, FAILED, INTERRUPTED, UNREAD = 0, 1, 130, 141  # exit codes
EXIT_CODES = """
0: done; a photograph without F is a result, with its reason
1: something failed: one line on stderr each, other photographs are done all the same
2: wrong usage
130: interrupted by Ctrl-C; files of photographs that are done are kept
141: what read the output wants no more of it, as head does; the rest is not done
"""


def printable(text: str) -> str:
    """Return a text on one line, with escapes for control characters."""
    return "".join(
        mark if mark.isprintable() else mark.encode("unicode_escape").decode("ascii") for mark in text
    )


def complain(error: Blur2ViewError) -> None:
    """Print one line on stderr, in place of the status that a person sees."""
    show_status()
    print(f"blur2view: {printable(str(error))}", file=sys.stderr, flush=True)


def plural(count: int, noun: str) -> str:
    """Return a count with its noun: "1 pair", "2 pairs"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def verdict_line(name: str, record: "Photograph") -> str:
    """Return a photograph's verdict and, where the camera moved, COLMAP's name of the configuration."""
    line = f"{printable(name)}: {record.verdict}"
    return f"{line} [{record.config}]" if record.moved() else line


def show_status(text: str = "") -> None:
    """Show a text as the last line of a terminal, in place of the one before; print nothing elsewhere."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{printable(text)}", end="", file=sys.stderr, flush=True)


@contextmanager
def waiting(text: str) -> Iterator[Callable[[int, int], None]]:
    """Show a text until the block ends; yield a function that shows how many of all steps are done."""
    show_status(f"{text} ...")
    try:
        yield lambda done, count: show_status(f"{text}: {done} of {count} ...")
    finally:
        show_status()
