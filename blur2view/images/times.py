"""The times of photographs that their names state."""

import os
import re
from collections.abc import Iterable
from pathlib import Path

from blur2view.errors import ImageError

UNIT_S = {10: 1.0, 13: 1e-3, 16: 1e-6, 19: 1e-9}
"""Seconds of one unit, by the digits of a whole number: s, ms, us and ns since 1970."""


def timestamp_of(name: str | os.PathLike[str]) -> float | None:
    """Return the time in seconds that a file's name states, None if it is not a time.

    A decimal fraction is seconds, as in TUM's recordings (``1305031102.175304.png``), a whole number of 10,
    13, 16 or 19 digits seconds, milli-, micro- or nanoseconds since 1970, as in EuRoC's and of ROS
    (``1403636579763555584.png``); any other name, such as the number of a frame, is not a time.
    """
    text = Path(name).stem
    if re.fullmatch(r"\d{1,19}\.\d+", text):  # more digits would be no time, or infinite
        return float(text)
    return int(text) * UNIT_S[len(text)] if re.fullmatch(r"\d+", text) and len(text) in UNIT_S else None


def timestamps_of(paths: Iterable[str | os.PathLike[str]]) -> list[float]:
    """Return the times of photographs, in seconds, that their names state.

    Parameters
    ----------
    paths : iterable of path
        Files named by a time: seconds with a fraction as in TUM's recordings, or whole seconds, milli-,
        micro- or nanoseconds since 1970 (10, 13, 16 or 19 digits) as in EuRoC's.

    Returns
    -------
    list of float
        Seconds, in the order of the paths.

    Raises
    ------
    ImageError
        If a name is not a time.

    Examples
    --------
    >>> from blur2view import timestamps_of
    >>> timestamps_of(["1305031102.175304.png", "cam0/1403636579763555584.png"])
    [1305031102.175304, 1403636579.7635558]
    """
    times = []
    for path in paths:
        if (time := timestamp_of(path)) is None:
            raise ImageError(f"{path}: its name is not a time; rename it, for example to 1403636579.763.png")
        times.append(time)
    return times
