"""What is printed: summaries on stdout, one line per failure on stderr, progress where a person watches."""

import sys
from collections.abc import Callable, Iterable
from typing import TypeVar

from blur2view.errors import Blur2ViewError

QUIET, SHORT, VERBOSE = -1, 0, 1
Say = Callable[..., None]
Job = TypeVar("Job")


def printable(text: str) -> str:
    """Return a text on one line in which what a terminal would obey is written as escapes."""
    return "".join(
        mark if mark.isprintable() else mark.encode("unicode_escape").decode("ascii") for mark in text
    )


def complain(error: Blur2ViewError, say: Say = print) -> None:
    """Print one line on stderr."""
    say(f"blur2view: {printable(str(error))}", file=sys.stderr)


def progress(jobs: list[Job]) -> tuple[Iterable[Job], Say]:
    """Return the jobs, with a progress bar where a person watches, and a print that keeps it whole."""
    if len(jobs) < 2 or not sys.stderr.isatty():
        return jobs, print
    from tqdm import tqdm  # 0.07 s, so only where it is seen

    return tqdm(jobs, unit="photo"), tqdm.write


def plural(count: int, noun: str) -> str:
    """Return a count with its noun: "1 pair", "2 pairs"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
