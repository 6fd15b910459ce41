"""What is printed: summaries on stdout, one line per failure on stderr, progress where a person watches."""

import sys
from collections.abc import Callable
from typing import Any, TextIO

from blur2view.errors import Blur2ViewError

QUIET, SHORT, VERBOSE = -1, 0, 1
Say = Callable[..., None]
PHOTOGRAPH, TILE = "photo", "tile"


def printable(text: str) -> str:
    """Return a text on one line in which what a terminal would obey is written as escapes."""
    return "".join(
        mark if mark.isprintable() else mark.encode("unicode_escape").decode("ascii") for mark in text
    )


def complain(error: Blur2ViewError, say: Say = print) -> None:
    """Print one line on stderr."""
    say(f"blur2view: {printable(str(error))}", file=sys.stderr)


class Progress:
    """A bar on stderr with rate and time left, where a person watches and there is more than one step."""

    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._bar: Any = None

    def show(self, done: int, total: int) -> None:
        """Show that so many steps are done; after the last one the bar ends."""
        if self._bar is None and total > 1 and sys.stderr.isatty():
            from tqdm import tqdm  # 0.07 s, so only where it is seen

            self._bar = tqdm(total=total, unit=self._unit, leave=self._unit == PHOTOGRAPH)
        if self._bar is not None:
            self._bar.update(done - self._bar.n)
            if done == total:
                self.close()

    def say(self, text: str, file: TextIO | None = None) -> None:
        """Print a line and keep the bar whole."""
        if self._bar is None:
            print(text, file=file)
        else:
            self._bar.write(text, file=file)

    def close(self) -> None:
        """End the bar."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def plural(count: int, noun: str) -> str:
    """Return a count with its noun: "1 pair", "2 pairs"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
