"""The values of options: numbers with their units, frames, paths."""

import math
from argparse import ArgumentTypeError
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


def seed(text: str) -> int:
    """Return a number of 0 or more."""
    if int(text) < 0:
        raise ArgumentTypeError(f"must not be negative, got {text}")
    return int(text)


def share(text: str) -> float:
    """Return a number above 0 and at most 1."""
    if not 0 < float(text) <= 1:
        raise ArgumentTypeError(f"must be above 0 and at most 1, got {text}")
    return float(text)


def probability(text: str) -> float:
    """Return a number above 0 and below 1."""
    if not 0 < float(text) < 1:
        raise ArgumentTypeError(f"must be above 0 and below 1, got {text}")
    return float(text)


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


def pixels(text: str) -> float:
    """Return a focal length in pixels; as few as millimetres would be need their unit."""
    amount, unit = number_and_unit(text, "px", "mm")
    try:
        value = float(amount)
    except ValueError:
        raise ArgumentTypeError(f"expected pixels as 800, got {text}") from None
    if unit != "px" and (unit or 0 < value < SHORT_PX):
        share = f"{value:g} mm of 35-mm film are {value / FILM_MM:.2f} of the picture's width"
        query = f"{text} is not in pixels;" if unit else f"{text} pixels or millimetres?"
        raise ArgumentTypeError(f"{query} {share}; write pixels, as {value:g}px, or --camera exif")
    return value


def radius(text: str) -> float:
    """Return a positive number of pixels."""
    value = amount(text.removesuffix("px"))
    if value.percent or not value.number:
        raise ArgumentTypeError(f"expected pixels above 0, as 2, got {text}")
    return value.number


def frame_or_seconds(text: str) -> int | float:
    """Return a frame's number, or a time in seconds as a float."""
    try:
        value = float(text.removesuffix("s")) if text.endswith("s") else int(text)
    except ValueError:
        value = -1
    if not 0 <= value < math.inf:
        raise ArgumentTypeError(f"expected a frame as 120 or a time as 12.5s, got {text}")
    return value


def amount(text: str) -> Amount:
    """Return a number of 0 or more, or a percentage as 50%."""
    try:
        value = float(text.removesuffix("%"))
    except ValueError:
        value = math.nan
    if not 0 <= value < math.inf:
        raise ArgumentTypeError(f"expected a number as 3 or a percentage as 50%, got {text}")
    return Amount(number=value, percent=text.endswith("%"))


def metres(text: str) -> float:
    """Return the metres of a distance on the ground, above 0, with its unit."""
    number, unit = number_and_unit(text, "mm", "cm", "m")
    try:
        value = float(number) * {"mm": 1e-3, "cm": 1e-2, "m": 1.0}[unit]
    except (KeyError, ValueError):
        value = math.nan
    if not 0 < value < math.inf:
        raise ArgumentTypeError(f"expected a distance with its unit as 2cm, got {text}")
    return value


def smear(text: str) -> Amount:
    """Return a length in pixels, a percentage of the diagonal, or a distance on the ground as 2cm."""
    if text.endswith("m"):
        return Amount(number=metres(text), metres=True)
    return amount(text.removesuffix("px"))


def best(text: str) -> Amount:
    """Return a number of photographs, 1 or more, or a percentage above 0 and at most 100."""
    value = amount(text)
    whole = value.number.is_integer() or value.percent
    if not whole or not 0 < value.number <= (100 if value.percent else math.inf):
        raise ArgumentTypeError(f"expected a number of photographs as 300 or 50%, got {text}")
    return value
