"""What is printed: summaries on stdout, one line per failure and progress on stderr."""

import io
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, TextIO

from blur2view.errors import Blur2ViewError

if TYPE_CHECKING:
    from blur2view.records.record import Record

DONE, FAILED, INTERRUPTED, UNREAD = 0, 1, 130, 141  # exit codes
EXIT_CODES = {
    "0": "done",
    "1": "failed; stderr has the reason, of many photographs a line for each, and the others are done",
    "2": "wrong usage, or a camera that cannot be used; nothing is done",
    "130": "interrupted by Ctrl-C; no file is left unfinished",
    "141": "the output pipe was closed early, for example by head; the rest is not done",
}
"""Exit codes of every command; the ``exit_codes`` of a command replace some of them."""
# Seconds until a bar appears, between drawings of it, and between lines in a file.
FIRST_S, REDRAW_S, LINE_S = 0.5, 0.25, 60.0
SMOOTHING = 0.1  # of the rate: photographs of an earlier call soon count no more
PARTS = "{desc}: {n} of {total}, {rate_noinv_fmt}, {remaining} left"
BAR = PARTS.replace(": ", ": {percentage:3.0f}%|{bar}| ", 1)
WHOLE = "{desc} ... {elapsed}"  # a step whose parts are not counted
DRAWING = threading.RLock()  # one thread at a time writes to the terminal
BARS: list[Any] = []  # the bar of tqdm that a terminal shows, if there is one


def printable(text: str) -> str:
    """Return a text on one line, with escapes for control characters."""
    return "".join(
        mark if mark.isprintable() else mark.encode("unicode_escape").decode("ascii") for mark in text
    )


def plural(count: int, noun: str) -> str:
    """Return a count with its noun: "1 pair", "2 pairs"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def verdict_line(record: "Record") -> str:
    """Return the verdict on a photograph, after its name."""
    return f"{printable(record.name)}: {record.verdict}"


def reason_line(record: "Record") -> str:
    """Return the reason of a geometry, after COLMAP's name of the configuration where the camera moved."""
    return f"{record.config}: {record.reason}" if record.moved() else record.reason


def say(text: str) -> None:
    """Print lines on stdout, above the bar that a person sees."""
    _print_above_bar(text, sys.stdout)


def complain(error: Blur2ViewError) -> None:
    """Print one line on stderr, above the bar that a person sees."""
    _print_above_bar(f"blur2view: {printable(str(error))}", sys.stderr)


def _print_above_bar(text: str, stream: TextIO) -> None:
    """Print lines while the bar, if there is one, is hidden.

    Ctrl-C has to leave the lock free wherever it comes, because the thread that draws would wait for ever.
    ``with`` does so; tqdm, which would take the lock once more, and generators do not.
    """
    with DRAWING:
        for bar in BARS:
            bar.clear(nolock=True)
        print(text, file=stream, flush=True)
        for bar in BARS:
            bar.refresh(nolock=True)


@contextmanager
def waiting(text: str, *, hidden: bool = False) -> Iterator[Callable[[int, int], None]]:
    """Show a step until the block ends; yield a function that notes how many of how many parts are done.

    On a terminal it is a bar with rate and time left, elsewhere a line a minute. Steps may follow each other.
    Nothing is shown of a step that is shorter than `FIRST_S`, or ``hidden``.
    """
    step = Step(printable(text))
    thread = threading.Thread(target=step.draw, daemon=True)  # the time moves on while a part takes long
    is_visible = not hidden and sys.stderr is not None
    if is_visible:
        thread.start()
    try:
        yield step.note
    finally:
        step.ended.set()
        if is_visible:
            thread.join()


def columns() -> int:
    """Return the width of the terminal, 80 columns where it is unknown, as in some CI systems."""
    with suppress(OSError, ValueError):
        return os.get_terminal_size(sys.stderr.fileno()).columns or 80
    return 80


class Step:
    """A step of a command, which tqdm draws until it has ended."""

    def __init__(self, text: str) -> None:
        self.text, self.done, self.count = text, 0, 0
        self.began, self.ended = time.time(), threading.Event()

    def note(self, done: int, count: int) -> None:
        """Note how many of how many parts are done."""
        self.done, self.count = done, count

    def draw(self) -> None:
        """Draw the step until it has ended; a terminal keeps nothing of it."""
        terminal = sys.stderr.isatty()
        pause_s, parts = (REDRAW_S, BAR) if terminal else (LINE_S, PARTS)
        if self.ended.wait(FIRST_S if terminal else pause_s):
            return
        bar = self._bar(terminal)
        with suppress(OSError):  # stderr may be closed
            while not self.ended.is_set():
                with DRAWING:
                    bar.total, bar.bar_format = self.count or None, parts if self.count else WHOLE
                    bar.ncols = columns()
                    if self.done > bar.n:
                        bar.update(self.done - bar.n)  # tqdm computes the rate here
                    bar.refresh()
                    if not terminal:
                        print(f"blur2view: {bar}", file=sys.stderr, flush=True)
                self.ended.wait(pause_s)
            with DRAWING:
                bar.close()
        BARS.clear()

    def _bar(self, terminal: bool) -> Any:
        """Return the bar of the step from its beginning on."""
        from tqdm import tqdm  # rich takes longer to import; only long steps pay for either

        tqdm.set_lock(DRAWING)
        tqdm.monitor_interval = 0  # no second thread that draws
        file = sys.stderr if terminal else io.StringIO()
        bar = tqdm(
            desc=self.text,
            unit="",
            unit_scale=True,  # or the rate is padded with spaces
            file=file,
            leave=False,
            nrows=20,  # tqdm hides the bar where a terminal does not know its height
            delay=1e-9,  # draw nothing yet
            smoothing=SMOOTHING,
        )
        bar.start_t = bar.last_print_t = self.began
        BARS.extend([bar] if terminal else [])
        return bar
