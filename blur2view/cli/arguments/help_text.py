"""The text of ``--help``: options and tables written as "name: explanation", paragraphs, examples."""

import re
import shutil
import textwrap
from argparse import BooleanOptionalAction
from collections.abc import Iterable, Sequence
from typing import Any

from blur2view.cli.arguments.parser import CommandParser, output_path
from blur2view.cli.arguments.values import frame_or_seconds, pixels, positive, seconds
from blur2view.results.document import Document

NAME_WIDTH = 24  # columns of the names in the help's tables, as argparse has it
PATHS = dict.fromkeys(("DB", "DIR", "FILE", "FRAMES", "HTML", "JSON", "LIST", "MODEL"), output_path)
TYPES: dict[str, Any] = {**PATHS, "FRAME": frame_or_seconds, "N": positive, "PX": pixels, "S": seconds}
"""What an option's value is, by the name that the help gives it."""
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


def add_options(group: Any, text: str, **settings: dict[str, Any]) -> None:
    """Add the options of a text, of lines as "-o, --output DIR: explanation", see `entries`.

    One without a value is a flag, --no-NAME one that is true without it, --[no-]NAME both. ``settings`` are
    those of `argparse` by the option's name, - written as _.
    """
    for names, explanation in entries(text):
        *short, last = names.split(", ")
        name, _, value = last.partition(" ")
        own = settings.get(name.lstrip("-").replace("-", "_"), {})
        kind = {} if {"action", "choices"} & own.keys() else _kind(name, value)
        group.add_argument(*short, name.replace("[no-]", ""), **{"help": explanation} | kind | own)


def _kind(name: str, value: str) -> dict[str, Any]:
    """Return what `argparse` makes of an option with such a value, empty of a flag."""
    if value:
        return {"metavar": value} | ({"type": TYPES[value]} if value in TYPES else {})
    if name.startswith("--[no-]"):
        return {"action": BooleanOptionalAction}
    if name.startswith("--no-"):
        return {"action": "store_false", "dest": name.removeprefix("--no-").replace("-", "_")}
    return {"action": "store_true"}


def width() -> int:
    """Return the columns that the help may fill."""
    return min(max(shutil.get_terminal_size().columns, 60), 110) - 2


def paragraph(text: str) -> str:
    """Return a text in lines of the terminal's width."""
    return textwrap.fill(" ".join(text.split()), width())


def entries(text: str) -> list[tuple[str, str]]:
    """Return names and explanations of a text: "name: explanation", whose other lines are indented."""
    whole = filter(None, re.sub(r"\n +", " ", text).splitlines())
    return [(name, explanation) for name, _, explanation in (line.partition(": ") for line in whole)]


def table(title: str, rows: str | type[Document] | Iterable[tuple[str, str]]) -> str:
    """Return a titled list of names and their explanations, as of `entries` or of a document's keys."""
    lines = [f"{title}:"]
    if isinstance(rows, type):
        rows = rows.explanations()
    for name, text in entries(rows) if isinstance(rows, str) else rows:
        first = f"  {name}".ljust(NAME_WIDTH - 1) + " "
        start = first if len(first) == NAME_WIDTH else " " * NAME_WIDTH
        lines += [] if start is first else [first.rstrip()]
        lines.append(textwrap.fill(text, width(), initial_indent=start, subsequent_indent=" " * NAME_WIDTH))
    return "\n".join(lines)


def explain(parser: CommandParser, description: str, tables: dict[str, Any], examples: Sequence[str]) -> None:
    """Add what stands above the options, and below them: tables by their titles, exit codes, examples."""
    parser.description = paragraph(description)
    titled = tables | {"exit codes": EXIT_CODES}
    parser.tables = lambda: [table(title, rows) for title, rows in titled.items()]
    parser.examples = "\n".join(["examples:", *(f"  {example}" for example in examples)])
