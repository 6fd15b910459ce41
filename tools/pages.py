"""What tools write: tables in Markdown, pages, and lines of JSON that a killed run goes on from."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any


def table(head: str, rows: Iterable[Sequence[object]]) -> list[str]:
    """Return a table in Markdown as lines; the head's cells have a bar between them."""
    lines = [f"| {' | '.join(map(str, cells))} |" for cells in rows]
    return [f"| {head} |", "|---" * (head.count("|") + 1) + "|", *lines]


def publish(text: str, path: Path | None) -> None:
    """Print a page, and write it where a path is given, whose folder is made."""
    print(text)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def write_json(path: Path, document: object) -> None:
    """Write a document, making its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document, indent=1) + "\n")


def append_line(path: Path, document: object) -> None:
    """Add a document to a file of one JSON document a line."""
    with path.open("a") as stream:
        stream.write(json.dumps(document) + "\n")


def begun(path: Path, head: dict[str, Any]) -> list[Any]:
    """Return the finished documents of a file whose first line is a head, or begin one.

    SystemExit if the head is another: results of two versions or settings must not be mixed.
    """
    lines = finished_lines(path)
    if not lines:
        path.parent.mkdir(parents=True, exist_ok=True)
        append_line(path, head)
    elif lines[0] != head:
        raise SystemExit(f"{path} was begun with {lines[0]}, not {head}: remove it or give another --log")
    return lines[1:]


def finished_lines(path: Path) -> list[Any]:
    """Return the documents of such a file; a last line that a kill cut short is left out and cut off."""
    if not path.exists():
        return []
    lines = [line for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]
    path.write_text("".join(lines))
    return [json.loads(line) for line in lines]
