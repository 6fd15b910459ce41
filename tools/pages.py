"""What tools write: tables in Markdown, pages, pictures, and lines of JSON that a killed run goes on from."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Record = dict[str, Any]  # a JSON object
Each = Callable[[Callable[[Record], Record], Sequence[Record]], Iterable[Record]]
"""`map`, or what does the same in several processes."""


def table(head: str, rows: Iterable[Sequence[object]]) -> list[str]:
    """Return a table in Markdown as lines; the head's cells have a bar between them."""
    lines = [f"| {' | '.join(map(str, cells))} |" for cells in rows]
    return [f"| {head} |", "|---" * (head.count("|") + 1) + "|", *lines]


def record_table(head: str, row: str, records: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return a table with a row for each record; ``row`` has formats of its items, ``{n} | {rho:.3f}``."""
    return table(head, ([row.format_map(record)] for record in records))


def joined(*blocks: str | Iterable[str]) -> str:
    """Return blocks of Markdown, each a text or lines, with an empty line between them."""
    texts = (block if isinstance(block, str) else "\n".join(block) for block in blocks)
    return "\n\n".join(text for text in texts if text) + "\n"


def filled(page: str, parts: Mapping[str, Iterable[str]]) -> str:
    """Return a page, whose words are by hand, with other lines from ``<!-- NAME -->`` to ``<!-- end -->``.

    ValueError if a mark is missing.
    """
    for name, lines in parts.items():
        before, mark, rest = page.partition(f"<!-- {name} -->\n")
        if not mark or "<!-- end -->" not in rest:
            raise ValueError(f"the page has no mark {name}")
        page = before + mark + "\n".join(lines) + "\n" + rest[rest.index("<!-- end -->") :]
    return page


def publish(text: str, path: Path | None) -> None:
    """Print a page, and write it where a path is given, whose folder is made."""
    print(text)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    """Write a picture (H, W, 3) RGB that holds photographs as WebP, which has a tenth of a PNG's bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture).save(path, "WEBP", quality=85, method=6)


def sweep(
    path: Path, head: Record, keys: Iterable[Record], work: Callable[[Record], Record], each: Each = map
) -> list[Record]:
    """Return the records of a file that starts with a head, after adding those of the keys that have none.

    ``work`` makes a key's record, which must hold the key's items. Every record is written when it is
    finished, so that a killed run goes on. SystemExit if the head is another: results of two versions or
    settings must not be mixed.
    """
    first, *records = finished_lines(path) or [None]
    if first is None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(head) + "\n")
    elif first != head:
        raise SystemExit(f"{path} was begun with {first}, not {head}: remove it or give another --log")
    pending = [key for key in keys if not any(key.items() <= record.items() for record in records)]
    for count, record in enumerate(each(work, pending) if pending else (), 1):
        with path.open("a") as stream:
            stream.write(json.dumps(record) + "\n")
        records.append(record)
        if count % 100 == 0 or count == len(pending):
            print(f"{path}: {count} of {len(pending)}", flush=True)
    return records


def finished_lines(path: Path) -> list[Any]:
    """Return the documents of such a file; a last line that a kill cut short is left out and cut off."""
    if not path.exists():
        return []
    lines = [line for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]
    path.write_text("".join(lines))
    return [json.loads(line) for line in lines]
