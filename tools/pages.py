"""What tools write: tables in Markdown, pages that say how they were made, pictures."""

import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Record = dict[str, Any]
"""The figures of one row."""


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


def publish(out: Path | None, *blocks: str | Iterable[str]) -> None:
    """Print a page and the command that makes it, and write both where a path is given."""
    name = getattr(sys.modules["__main__"].__spec__, "name", Path(sys.argv[0]).name)
    text = joined(*blocks, f"Made by `python -m {name} {shlex.join(sys.argv[1:])}`.")
    print(text)
    if out is not None:
        out.write_text(text)


def fill(page: Path, parts: Mapping[str, Iterable[str]], out: Path) -> None:
    """Write a page whose words are by hand, with new lines from each ``<!-- NAME -->`` to ``<!-- end -->``.

    ValueError if a mark is missing.
    """
    text = page.read_text()
    for name, lines in parts.items():
        before, mark, rest = text.partition(f"<!-- {name} -->\n")
        if not mark or "<!-- end -->" not in rest:
            raise ValueError(f"{page}: has no mark {name}")
        text = before + mark + "\n".join(lines) + "\n" + rest[rest.index("<!-- end -->") :]
    out.write_text(text)


def write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    """Write a picture (H, W, 3) RGB that holds photographs as WebP, which has a tenth of a PNG's bytes."""
    Image.fromarray(picture).save(path, "WEBP", quality=85, method=6)
