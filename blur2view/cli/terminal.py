"""What is printed: summaries on stdout, one line per failure and progress on stderr."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from blur2view.errors import Blur2ViewError

Say = Callable[..., None]
PATIENCE_S = 2  # until a bar is shown


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


def verdict_line(name: str, verdict: str, config: str) -> str:
    """Return the one sentence that matters of a photograph, then the configuration by COLMAP's name."""
    return f"{printable(name)}: {verdict} [{config}]"


def seconds_lines(timings_s: Mapping[str, float] | None) -> list[str]:
    """Return a line on the seconds of each step, none where nobody wants it."""
    if timings_s is None:
        return []
    steps = ", ".join(f"{name} {seconds:.2f}" for name, seconds in timings_s.items())
    return [f"{sum(timings_s.values()):.2f} s ({steps})"]


@contextmanager
def progress(count: int, about: str) -> Iterator[tuple[Say, Callable[[], object]]]:
    """Yield what prints a line, and what tells of a step that is done.

    Where a person watches and several steps take more than `PATIENCE_S`, a bar stands below the lines, with
    the rate and what is left, after a line ``about`` them.
    """
    if count < 2 or not sys.stderr.isatty():
        yield print, lambda: None
        return
    from tqdm import tqdm  # 0.07 s

    if about:
        print(printable(about), file=sys.stderr)
    start = time.monotonic()
    with tqdm(total=count, unit="photo", delay=PATIENCE_S, leave=False, dynamic_ncols=True) as bar:

        def say(text: str, **how: Any) -> None:
            (bar.write if time.monotonic() > start + PATIENCE_S else print)(text, **how)

        yield say, bar.update


@contextmanager
def waiting(text: str) -> Iterator[None]:
    """Show a person what is waited for, until it is done: of one step, whose end nobody knows."""
    shown = f"{printable(text)} ..." if sys.stderr.isatty() else ""
    print(shown, end="", file=sys.stderr, flush=True)
    try:
        yield
    finally:
        print("\r\x1b[K" * bool(shown), end="", file=sys.stderr, flush=True)
