"""The values of options: numbers with their units, frames, paths."""

import math
from argparse import ArgumentTypeError
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

LONG_S, SHORT_PX = 2.0, 100.0  # an exposure beyond, a focal length below is asked about
SHORTEST_S = 1e-9  # no shutter and no flash is as short
RATE = 30  # frames a second, of an example
FILM_MM = 36.0  # width of 35-mm film


@dataclass(frozen=True, kw_only=True)
class Amount:
    """A number, or a percentage of what is known later, or metres."""

    number: float
    percent: bool = False
    metres: bool = False

    @property
    def unit(self) -> str:
        """The unit of a length."""
        return "%" if self.percent else " m" if self.metres else " px"

    def __str__(self) -> str:
        return ground_text(self.number) if self.metres else f"{self.number:g}{'%' if self.percent else ''}"


def ground_text(metres: float) -> str:
    """Return a distance on the ground in centimetres, or metres."""
    return f"{100 * metres:.3g} cm" if metres < 1 else f"{metres:.3g} m"


def file_path(text: str) -> Path:
    """Return the path of a file or a folder."""
    if "\0" in text:
        raise ArgumentTypeError("a path has no null character")
    return Path(text)


def positive(text: str) -> int:
    """Return a number of 1 or more."""
    if not text.isdecimal() or int(text) < 1:
        raise ArgumentTypeError(f"must be 1 or more, got {text}")
    return int(text)


def frames(text: str) -> int:
    """Return a number of frames, 1 or more."""
    amount, unit = number_and_unit(text, "ms", "s")
    with suppress(ValueError):
        if unit and (count := round(RATE * float(amount) / (1000 if unit == "ms" else 1))) >= 1:
            raise ArgumentTypeError(f"counts frames; {text} are {count} in a video of {RATE} a second")
    return positive(text)


def within(kind: type, words: str, allowed: Callable[[float], bool]) -> Callable[[str], float]:
    """Return what reads a number of a type that is ``allowed``, which is in words for the message."""

    def number(text: str) -> float:
        value: float = kind(text)
        if not allowed(value):
            raise ArgumentTypeError(f"must {words}, got {text}")
        return value

    return number


seed = within(int, "not be negative", lambda value: value >= 0)
share = within(float, "be above 0 and at most 1", lambda value: 0 < value <= 1)
probability = within(float, "be above 0 and below 1", lambda value: 0 < value < 1)


def number_and_unit(text: str, *units: str) -> tuple[str, str]:
    """Return a text without the first of these units that it ends with, and that unit, empty if none."""
    unit = next((one for one in units if text.endswith(one)), "")
    return text.removesuffix(unit), unit


def seconds(text: str) -> float:
    """Return seconds, of a number, a fraction as 1/25 or milliseconds as 40ms; a long time needs its unit."""
    amount, unit = number_and_unit(text, "ms", "s")
    above, slash, below = amount.partition("/")
    try:
        value = float(above) / (float(below) if slash else 1.0) / (1000 if unit == "ms" else 1)
    except (ValueError, ZeroDivisionError):
        raise ArgumentTypeError(f"expected seconds as 0.04 or 1/25, got {text}") from None
    if not unit and LONG_S < value < math.inf:
        raise ArgumentTypeError(f"{text} seconds or milliseconds? write {text}s, {text}ms or 1/{text}")
    return value


def exposure(text: str) -> float:
    """Return the seconds of an exposure."""
    value = seconds(text)
    if not SHORTEST_S < value < math.inf:
        raise ArgumentTypeError(f"must be above {SHORTEST_S:g} s and finite, got {text}")
    return value


def measured(
    text: str, expected: str, *units: str, allowed: Callable[[float, str], object] = lambda value, unit: True
) -> tuple[float, str]:
    """Return a finite number of 0 or more and its unit, one of these or empty: what is ``expected``."""
    number, unit = number_and_unit(text, *units)
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not 0 <= value < math.inf or not allowed(value, unit):
        raise ArgumentTypeError(f"expected {expected}, got {text}")
    return value, unit


def pixels(text: str) -> float:
    """Return a focal length in pixels; as few as millimetres would be need their unit."""
    value, unit = measured(text, "pixels as 800", "px", "mm")
    if unit != "px" and (unit or 0 < value < SHORT_PX):
        share = f"{value:g} mm of 35-mm film are {value / FILM_MM:.2f} of the picture's width"
        query = f"{text} is not in pixels;" if unit else f"{text} pixels or millimetres?"
        raise ArgumentTypeError(f"{query} {share}; write pixels, as {value:g}px, or --camera exif")
    return value


def radius(text: str) -> float:
    """Return a positive number of pixels."""
    return measured(text, "pixels above 0, as 2", "px", allowed=lambda value, _: value)[0]


def frame_or_seconds(text: str) -> int | float:
    """Return a frame's number, or a time in seconds as a float."""
    expected = "a frame as 120 or a time as 12.5s"
    value, unit = measured(text, expected, "s", allowed=lambda value, unit: unit or value.is_integer())
    return value if unit else int(value)


def metres(text: str) -> float:
    """Return the metres of a distance on the ground, above 0, with its unit."""
    units = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
    expected = "a distance with its unit as 2cm"
    value, unit = measured(text, expected, *units, allowed=lambda value, unit: value and unit)
    return value * units[unit]


def smear(text: str) -> Amount:
    """Return a length in pixels, a percentage of the diagonal, or a distance on the ground as 2cm."""
    if text.endswith("m"):
        return Amount(number=metres(text), metres=True)
    value, unit = measured(text.removesuffix("px"), "a number as 3 or a percentage as 50%", "%")
    return Amount(number=value, percent=bool(unit))


def best(text: str) -> Amount:
    """Return a number of photographs, 1 or more, or a percentage above 0 and at most 100."""
    value, unit = measured(
        text,
        "a number of photographs as 300 or 50%",
        "%",
        allowed=lambda value, unit: 0 < value <= 100 if unit else value >= 1 and value.is_integer(),
    )
    return Amount(number=value, percent=bool(unit))
