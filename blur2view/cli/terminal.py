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

    def __init__(self, total: int, unit: str) -> None:
        self._bar: Any = None
        if total > 1 and sys.stderr.isatty():
            from tqdm import tqdm  # 0.07 s, so only where it is seen

            self._bar = tqdm(total=total, unit=unit, leave=unit == PHOTOGRAPH)

    def step(self) -> None:
        """Count one step."""
        if self._bar is not None:
            self._bar.update()

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


class TileProgress:
    """A bar for the tiles of a large photograph, called after each of them."""

    def __init__(self) -> None:
        self._bar: Progress | None = None

    def __call__(self, done: int, count: int) -> None:
        """Show that so many tiles are done."""
        if done == 1:
            self._bar = Progress(count, TILE)
        if self._bar is not None:
            self._bar.step()
            if done == count:
                self._bar.close()


def plural(count: int, noun: str) -> str:
    """Return a count with its noun: "1 pair", "2 pairs"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
