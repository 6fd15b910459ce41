"""What tools write: tables in Markdown, pages that say how they were made, pictures.

``python -m tools.pages PICTURE --out tools/results/NAME.webp`` reduces a picture that a command drew.
"""

import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tools.arguments import Existing, Target, run


def table(head: str, rows: Iterable[Sequence[object]]) -> list[str]:
    """Return a table in Markdown as lines; the head's cells have a bar between them."""
    lines = [f"| {' | '.join(map(str, cells))} |" for cells in rows]
    return [f"| {head} |", "|---" * (head.count("|") + 1) + "|", *lines]


def joined(*blocks: str | Iterable[str]) -> str:
    """Return blocks of Markdown, each a text or lines, with an empty line between them."""
    return "\n\n".join(one if isinstance(one, str) else "\n".join(one) for one in blocks) + "\n"


def publish(out: Path | None, *blocks: str | Iterable[str]) -> None:
    """Print a page and the command that makes it, and write both where a path is given."""
    name = getattr(sys.modules["__main__"].__spec__, "name", Path(sys.argv[0]).name)
    text = joined(*blocks, f"Made by `python -m {name} {shlex.join(sys.argv[1:])}`.")
    print(text)
    if out is not None:
        out.write_text(text)


def fill(page: Path, parts: Mapping[str, str], out: Path) -> None:
    """Write a page whose words are by hand, with new text from each ``<!-- NAME -->`` to ``<!-- end -->``.

    ValueError if a mark is missing.
    """
    text = page.read_text()
    for name, new in parts.items():
        before, mark, rest = text.partition(f"<!-- {name} -->\n")
        if not mark or "<!-- end -->" not in rest:
            raise ValueError(f"{page}: has no mark {name}")
        text = before + mark + new + rest[rest.index("<!-- end -->") :]
    out.write_text(text)


def write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    """Write a picture (H, W, 3) RGB that holds photographs as WebP, which has a tenth of a PNG's bytes."""
    Image.fromarray(picture).save(path, "WEBP", quality=85, method=6)


def main(picture: Existing, *, out: Target, width: int = 960) -> None:
    """Write a picture so many pixels wide, or as it is where it is narrower."""
    with Image.open(picture) as shown:
        shown.thumbnail((width, shown.height), Image.Resampling.LANCZOS)
        write_picture(out, np.asarray(shown.convert("RGB")))


if __name__ == "__main__":
    run(main)
