"""What is printed: summaries on stdout, one line per failure on stderr."""

import sys
from collections.abc import Callable

from blur2view.errors import Blur2ViewError

Say = Callable[..., None]


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
