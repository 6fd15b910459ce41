"""The text of ``--help``: how it is laid out, and tables written as "name: explanation"."""

import argparse
import re
import shutil
from collections.abc import Mapping
from typing import Any

from blur2view.results.document import Document

EXIT_CODES = """
0: done; a photograph without F is a result, with its reason
1: something failed: one line on stderr each, other photographs are done all the same
2: wrong usage
130: interrupted by Ctrl-C: what is done is kept, --resume goes on
141: what read the output wants no more of it, as head does; the rest is not done
"""
MANIFEST = """
.<command>.manifest.jsonl: the hidden manifest, JSON lines: what --resume goes on
    with
"""
Rows = str | type[Document] | Mapping[str, str]


class Layout(argparse.HelpFormatter):
    """As argparse has it, no wider than is read with ease; a text of several lines keeps them."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=min(max(shutil.get_terminal_size().columns, 60), 110) - 2)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if "\n" in text else super()._fill_text(text, width, indent)


def add_table(parser: Any, title: str, rows: Rows) -> None:
    """Add a titled list to what the help shows below the options: of a text, or of a document its keys.

    A text has lines as "name: explanation", of which further ones are indented.
    """
    if isinstance(rows, str):
        rows = dict(line.split(": ", 1) for line in re.sub(r"\n +", " ", rows).splitlines() if line)
    group = parser.add_argument_group(title)
    for name, text in rows.explanations() if isinstance(rows, type) else rows.items():
        group._group_actions.append(argparse.Action([], "", metavar=name, help=text.replace("%", "%%")))
