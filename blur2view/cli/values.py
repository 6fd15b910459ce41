"""The values of options: numbers with their units, frames, paths."""

import math
import re
from argparse import ArgumentTypeError
from collections.abc import Callable
from pathlib import Path

from blur2view.geometry.rolling_shutter import LONG_S

SHORT_PX = 100.0  # a focal length below, as an exposure beyond LONG_S, needs its unit
Allowed = Callable[[float, str], object]


def file_path(text: str) -> Path:
    """Return the path of a file or a folder."""
    if "\0" in text:
        raise ArgumentTypeError("a path has no null character")
    return Path(text)


def whole(least: int) -> Callable[[str], int]:
    """Return what reads a whole number of this or more."""

    def number(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise ArgumentTypeError(f"must be a whole number, {least} or more, got {text}")
        return int(text)

    return number


def measured(text: str, expected: str, allowed: Allowed, *units: str) -> tuple[float, str]:
    """Return a finite number of 0 or more, or a fraction as 1/25, and its unit, one of these or empty.

    It is what is ``expected`` if it is ``allowed``.
    """
    unit = next((one for one in units if text.endswith(one)), "")
    above, slash, below = text.removesuffix(unit).partition("/")
    try:
        value = float(above) / (float(below) if slash else 1.0)
    except (ValueError, ZeroDivisionError):
        value = math.nan
    if not 0 <= value < math.inf or not allowed(value, unit):
        raise ArgumentTypeError(f"expected {expected}, got {text}")
    return value, unit


def quantity(expected: str, allowed: Allowed, **units: float) -> Callable[[str], float]:
    """Return what reads what is ``expected``, where so many of a unit are one of what is returned."""

    def number(text: str) -> float:
        value, unit = measured(text, expected, allowed, *units)
        return value / units.get(unit, 1)

    return number


SECONDS = "seconds as 0.04 or 1/25, more than 2 with their unit as 3s or 40ms"
share = quantity("a share above 0 and at most 1", lambda value, _: 0 < value <= 1)
probability = quantity("a probability above 0 and below 1", lambda value, _: 0 < value < 1)
seconds = quantity(SECONDS, lambda value, unit: unit or value <= LONG_S, ms=1000, s=1)
exposure_s = quantity(SECONDS, lambda value, unit: value > 1e-9 and (unit or value <= LONG_S), ms=1000, s=1)
focal_px = quantity(
    "pixels, as 800, or 80px for fewer than 100 (--camera exif reads millimetres from the photograph)",
    lambda value, unit: unit or value >= SHORT_PX,
    px=1,
)
radius = quantity("pixels above 0, as 2", lambda value, _: value, px=1)
length = quantity("pixels, as 3", lambda *_: True, px=1)


def frame_or_seconds(text: str) -> int | float:
    """Return a frame's number, or a time in seconds as a float."""
    expected = "a frame as 120 or a time as 12.5s"
    value, unit = measured(text, expected, lambda value, unit: unit or value.is_integer(), "s")
    return value if unit else int(value)


def dask_address(text: str) -> str:
    """Return the address of a scheduler, which others than that of TCP do not reach."""
    if not re.fullmatch(r"tcp://(\[[\d:.a-fA-F]+\]|[^/:\[\]]+):\d{1,5}", text):
        raise ArgumentTypeError(f"expected tcp://HOST:PORT, got {text}")
    return text


def one_of(*names: str) -> Callable[[str], str]:
    """Return what reads one of these names."""

    def name(text: str) -> str:
        if text not in names:
            raise ArgumentTypeError(f"expected {', '.join(names[:-1])} or {names[-1]}, got {text}")
        return text

    return name
