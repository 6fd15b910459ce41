"""Times of the photographs of a folder: from their names, or from the table beside them."""

import os
import re
from collections.abc import Iterable
from pathlib import Path

from blur2view.errors import ImageError
from blur2view.input_files import read_regular

UNIT_S = {10: 1.0, 13: 1e-3, 16: 1e-6, 19: 1e-9}
"""Seconds, by the digits of a whole number: those of our years since 1970 in s, ms, us and ns."""
MAX_BYTES = 1 << 25


def timestamp_of(name: str | os.PathLike[str]) -> float | None:
    """Return the seconds that a file is called by, None if its name is no time.

    A decimal fraction is seconds, as of TUM's recordings (``1305031102.175304.png``), a whole number of 10,
    13, 16 or 19 digits seconds, milli-, micro- or nanoseconds since 1970, as of EuRoC's and of ROS
    (``1403636579763555584.png``); anything else, as the number of a frame, is no time.
    """
    return _seconds(Path(name).stem)


def timestamps_of(
    paths: Iterable[str | os.PathLike[str]], table: str | os.PathLike[str] | None = None
) -> list[float]:
    """Return the seconds of photographs in order, from their names or from a column of a table.

    Parameters
    ----------
    paths : iterable of path-like
        The photographs.
    table : path-like, optional
        Text with a row for each photograph, which names it in one column and has its time, as `timestamp_of`
        reads it, in another one, parted by commas or spaces; lines that begin with # are passed over. EuRoC's
        ``data.csv`` and TUM's ``rgb.txt`` are such tables.

    Raises
    ------
    ImageError
        If the table cannot be read, or a photograph has no time.
    """
    times = {} if table is None else _read(Path(table))
    found = []
    for path in map(Path, paths):
        if (time := timestamp_of(path) if table is None else times.get(path.name)) is None:
            where = "its name is no time" if table is None else f"{table} has no time of it"
            raise ImageError(f"{path}: {where}; name a table that has one")
        found.append(time)
    return found


def _read(table: Path) -> dict[str, float]:
    """Return the times of a table by the photographs' names without their folders."""
    try:
        text = read_regular(table, MAX_BYTES).decode()
    except (OSError, ValueError) as error:
        raise ImageError(f"{table}: cannot be read ({error}); name a table of times") from None
    times: dict[str, float] = {}
    for line in text.splitlines():
        cells = [cell.strip() for cell in re.split(r"[,\s]+", line.strip()) if cell]
        if cells and not cells[0].startswith("#"):
            values = [value for value in map(_seconds, cells) if value is not None]
            times |= {Path(cell).name: values[0] for cell in cells if Path(cell).suffix and values}
    return times


def _seconds(text: str) -> float | None:
    """Return the seconds that a number stands for, None of any other text."""
    if re.fullmatch(r"\d{1,19}\.\d+", text):  # more would be no time, or infinite
        return float(text)
    return int(text) * UNIT_S[len(text)] if re.fullmatch(r"\d+", text) and len(text) in UNIT_S else None
