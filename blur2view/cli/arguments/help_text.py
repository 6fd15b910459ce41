"""The text of ``--help``: paragraphs, and tables written as "name: explanation"."""

import re
import shutil
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field

from blur2view.results.document import Document

NAME_WIDTH = 24  # columns of the names in the help's tables, as argparse has it
EXIT_CODES = """
0: done; a photograph without F is a result, with its reason
1: something failed: one line on stderr each, other photographs are done all the same
2: wrong usage
130: interrupted by Ctrl-C: what is done is kept, --resume goes on
"""
MANIFEST = """
<command>.manifest.jsonl: the manifest of a call of several photographs, JSON lines: what --resume goes on
    with
"""
Rows = str | type[Document] | Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class Help:
    """What the help of a command says besides its options; ``--help`` leaves the tables out."""

    description: str
    examples: tuple[str, ...]
    tables: Mapping[str, Rows] = field(default_factory=dict)


def width() -> int:
    """Return the columns that the help may fill."""
    return min(max(shutil.get_terminal_size().columns, 60), 110) - 2


def paragraph(text: str) -> str:
    """Return a text in lines of the terminal's width."""
    return textwrap.fill(" ".join(text.split()), width())


def table(title: str, rows: Rows) -> str:
    """Return a titled list of names and their explanations, of a document its keys.

    Of a text lines as "name: explanation", of which further ones are indented.
    """
    if isinstance(rows, str):
        whole = filter(None, re.sub(r"\n +", " ", rows).splitlines())
        named = [line.split(": ", 1) for line in whole]
    else:
        named = list(map(list, rows.explanations() if isinstance(rows, type) else rows.items()))
    lines = [f"{title}:"]
    for name, text in named:
        first = f"  {name}".ljust(NAME_WIDTH - 1) + " "
        start = first if len(first) == NAME_WIDTH else " " * NAME_WIDTH
        lines += [] if start is first else [first.rstrip()]
        lines.append(textwrap.fill(text, width(), initial_indent=start, subsequent_indent=" " * NAME_WIDTH))
    return "\n".join(lines)
