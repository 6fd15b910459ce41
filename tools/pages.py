"""What tools write: tables in Markdown, and pages that name the command that made them."""

import shlex
import sys
from collections.abc import Iterable
from pathlib import Path

MADE, END = "<!-- made -->\n", "<!-- end -->"


def table(head: str, rows: Iterable[Iterable[object]]) -> list[str]:
    """Return a table in Markdown as lines; the head's cells have a bar between them."""
    lines = [f"| {' | '.join(map(str, cells))} |" for cells in rows]
    return [f"| {head} |", "|---" * (head.count("|") + 1) + "|", *lines]


def publish(out: Path | None, *blocks: str | Iterable[str]) -> None:
    """Print blocks, each a text or lines, and the command that made them; write them where a path is given.

    A page that has the marks `MADE` and `END` keeps the words around them, which are by hand.
    """
    name = getattr(sys.modules["__main__"].__spec__, "name", Path(sys.argv[0]).name)
    made = f"Made by `python -m {name} {shlex.join(sys.argv[1:])}`."
    text = "\n\n".join(one if isinstance(one, str) else "\n".join(one) for one in (*blocks, made)) + "\n"
    print(text)
    if out is not None:
        before, mark, rest = (out.read_text() if out.exists() else "").partition(MADE)
        end, after = rest.partition(END)[1:]
        out.write_text(before + mark + text + end + after if end else text)
