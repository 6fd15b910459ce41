"""Options: fields of dataclasses with their help, how words are read, and the parser of a command.

A command is a frozen dataclass of options and of groups of options, which commands share. The first line of
a group's docstring is its title, the rest what the help says above its options; of a command the rest is its
description. Options that a class lists as ``either`` exclude each other.
"""

import argparse
import inspect
import math
import os
import re
import shutil
import sys
import textwrap
from argparse import ArgumentTypeError, BooleanOptionalAction
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NoReturn, get_args, get_origin

from blur2view.camera import LONG_S, SHORT_S
from blur2view.cli.terminal import EXIT_CODES, printable
from blur2view.errors import CameraError

SHORT = re.compile(r"; |\. |, see below| \(default")  # where the first words of an explanation end
DEFAULT = re.compile(r"\((default: (?:%\(default\)|[^,;)])+)")
GROUPS = ("input", "output", "camera", "time", "estimation", "many photographs", "printing")
"""Titles of groups of options, in the order of the help."""
MIN_LIKENESS = 0.8  # of an option to the word that was written, to be proposed; difflib's ratio
MIN_FOCAL_PX = 100.0  # a smaller focal length needs its unit: it may be millimetres
MEANT = {"INPUT": "photographs, a folder or a video"}
"""What is asked for where an argument is missing, instead of its name."""


def option(text: str, default: Any = None, *, rare: bool = False) -> Any:
    """Return the field of an option whose text is ``--every N: of a video take one frame in N``.

    Without a dash, as ``INPUT: photographs``, it is an argument. What is ``rare`` is in --help-all alone. The
    type says how a word is read: ``Annotated[float, function]`` by a function.
    """
    spec, _, explanation = " ".join(text.split()).partition(": ")
    words = spec.replace(",", "").split()
    names = [word for word in words if word.startswith("-")]
    metavar = words[-1] if words[-1] not in names else None
    return field(
        default=default, metadata={"names": names, "metavar": metavar, "help": explanation, "rare": rare}
    )


rare_option = partial(option, rare=True)
flag = partial(option, default=False)
required = partial(option, default=MISSING)


def whole(minimum: int) -> Callable[[str], int]:
    """Return a reader of whole numbers from ``minimum`` on."""

    def number(text: str) -> int:
        if not text.isdecimal() or int(text) < minimum:
            raise ArgumentTypeError(f"must be a whole number, {minimum} or more, got {text}")
        return int(text)

    return number


def quantity(
    expected: str, allowed: Callable[[float, str], object] = lambda *_: True, **units: float
) -> Callable[[str], float]:
    """Return a reader of numbers of 0 or more, or fractions as 1/25.

    ``units`` maps a suffix to how many of it make one. The value and its suffix, empty without one, must be
    ``allowed``; ``expected`` says what is.
    """

    def number(text: str) -> float:
        unit = next((suffix for suffix in units if text.endswith(suffix)), "")
        above, slash, below = text.removesuffix(unit).partition("/")
        try:
            value = float(above) / (float(below) if slash else 1.0)
        except (ValueError, ZeroDivisionError):
            value = math.nan
        if not 0 <= value < math.inf or not allowed(value, unit):
            raise ArgumentTypeError(f"expected {expected}, got {text}")
        return value / units.get(unit, 1)

    return number


SECONDS = "seconds as 0.04 or 1/25, more than 2 with their unit as 3s or 40ms"
share = quantity("a share above 0 and at most 1", lambda value, _: 0 < value <= 1)
probability = quantity("a probability above 0 and below 1", lambda value, _: 0 < value < 1)
seconds = quantity(SECONDS, lambda value, unit: unit or value <= LONG_S, ms=1000, s=1)
exposure_s = quantity(
    SECONDS, lambda value, unit: value > SHORT_S and (unit or value <= LONG_S), ms=1000, s=1
)
focal_px = quantity(
    "a positive number of pixels, as 800, or 80px for fewer than 100 (--camera exif reads millimetres)",
    lambda value, unit: unit or value >= MIN_FOCAL_PX,
    px=1,
)
radius = quantity("pixels above 0, as 2", lambda value, _: value, px=1)


@dataclass(frozen=True)
class Length:
    """A length in a photograph."""

    value: float
    of_width: bool = False  # per cent of the photograph's width, otherwise pixels

    def px(self, width: int) -> float:
        """Return the length in pixels, in a photograph of this width."""
        return self.value / 100 * width if self.of_width else self.value

    def __str__(self) -> str:
        """Return it as the user states it."""
        return f"{self.value:g}{'%' if self.of_width else ''}"


def length(text: str) -> Length:
    """Return a length in pixels, or as 0.3% of the width; 0 is one."""
    expected = "pixels as 3, or per cent of the width as 0.3%"
    value = quantity(expected, lambda *_: True, **{"px": 1.0, "%": 1.0})(text)
    return Length(value, of_width=text.endswith("%"))


def frame_or_seconds(text: str) -> int | float:
    """Return the number of a frame, or a time in seconds as a float."""
    if text.isdecimal():
        return int(text)
    expected = "a frame counted from 0, as 120, or a time with its unit, as 12.5s"
    return quantity(expected, lambda _, unit: unit, ms=1000, s=1)(text)


def file_path(text: str) -> Path:
    """Return the path of a file to write; a slash at its end would name a folder."""
    if text.endswith(("/", os.sep)):
        raise ArgumentTypeError(f"expected a file, got the folder {text}")
    return Path(text)


def neighbours(text: str) -> int | float:
    """Return a number of neighbours, at least 1, or a duration in seconds, above 0, as a float."""
    if text.isdecimal():
        return whole(1)(text)
    return quantity("a number as 10 or a duration as 0.5s", lambda value, unit: unit and value > 0, s=1)(text)


def dask_address(text: str) -> str:
    """Return the address of a scheduler that is reached by TCP, which alone is tried."""
    if not re.fullmatch(r"tcp://(\[[\d:.a-fA-F]+\]|[^/:\[\]]+):\d{1,5}", text):
        raise ArgumentTypeError(f"expected tcp://HOST:PORT, got {text}")
    return text


class OneOf:
    """A reader of one of some names."""

    def __init__(self, *names: str) -> None:
        self.names = names

    def __call__(self, text: str) -> str:
        """Return the name."""
        if text not in self.names:
            names = f"{', '.join(self.names[:-1])} or {self.names[-1]}"
            raise ArgumentTypeError(f"expected {names}, got {text}")
        return text


def real(text: str) -> float:
    """Return a number."""
    try:
        return float(text)
    except ValueError:
        raise ArgumentTypeError(f"expected a number, got {text!r}") from None


READERS: dict[Any, Callable[[str], Any]] = {Path: Path, int: whole(1), float: real}
"""What makes a value of a word, by the type of the field."""


def split_docstring(kind: Any) -> tuple[str, str]:
    """Split a class's docstring: the first line without its full stop, and the rest as one line."""
    first, _, rest = inspect.cleandoc(kind.__doc__ or "").partition("\n\n")
    return first.removesuffix("."), " ".join(rest.split())


class Layout(argparse.HelpFormatter):
    """Argparse's layout, 60 to 110 columns wide; a text of several lines keeps them."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=min(max(shutil.get_terminal_size().columns, 60), 110) - 2)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n" in text:
            return text
        lines = self._split_lines(text, width - len(indent))
        return "\n".join(indent + line for line in lines)

    def _split_lines(self, text: str, width: int) -> list[str]:
        return textwrap.wrap(" ".join(text.split()), width, break_on_hyphens=False)  # nor names of options


class Parser(argparse.ArgumentParser):
    """A parser that prints one line on wrong usage, and raises OSError if help cannot be printed."""

    def _print_message(self, message: str, file: Any = None) -> None:
        (file or sys.stderr).write(message)

    def error(self, message: str) -> NoReturn:
        """Exit with one line, in which what a terminal would obey is written as escapes."""
        self.exit(2, f"{self.prog}: {printable(message)} (see {self.prog} --help)\n")

    def add_table(self, title: str, rows: str | Mapping[str, str]) -> None:
        """Add a titled list to the help below the options; further lines of a row are indented."""
        if isinstance(rows, str):
            rows = dict(line.split(": ", 1) for line in re.sub(r"\n +", " ", rows).splitlines() if line)
        section = self.add_argument_group(title)
        for name, text in rows.items():
            section._group_actions.append(argparse.Action([], "", metavar=name, help=text.replace("%", "%%")))


class CommandParser(Parser):
    """The parser of a command's dataclass.

    Its help has the options that are not rare, in a few words each, and the examples; with ``everything`` all
    of them, and the ``tables`` of the command: titles with lines "name: explanation", or mappings of these.
    """

    def __init__(self, command: str, kind: Any, *, everything: bool = False) -> None:
        super().__init__(
            prog=f"blur2view {command}", formatter_class=Layout, allow_abbrev=False, exit_on_error=False
        )
        self.command, self.kind, self.everything = command, kind, everything
        self.description = split_docstring(kind)[1]
        more = f"all options and files: {self.prog} --help-all"
        self.epilog = "\n  ".join(["examples:", *kind.examples])
        if not everything:
            self.epilog += f"\n\n{more}"
        self.add_argument("--help-all", action="help", help="show all options and files, and exit")
        self._sections: dict[str, Any] = {"options": self._optionals}
        self._add(kind, "options")
        self._needed = [action for action in self._actions if action.required]
        self.usage = f"{self.prog} [OPTIONS]"
        for action in self._needed:
            action.required = False  # `read` says what is missing
            words = [*action.option_strings[:1], str(action.metavar)]
            self.usage += " " + " ".join(words) + ("..." if action.nargs == "+" else "")
        if everything:
            codes = EXIT_CODES | getattr(kind, "exit_codes", {})
            for title, rows in (getattr(kind, "tables", {}) | {"exit codes": codes}).items():
                self.add_table(title, rows)

    def _add(self, kind: Any, title: str, about: str | None = None) -> None:
        """Add the options of a dataclass and of its groups; all their names differ."""
        either = None
        for entry in sorted(fields(kind), key=_place):
            if is_dataclass(entry.type):
                name, text = split_docstring(entry.type)
                self._add(entry.type, name.lower(), text or None)
                continue
            if title not in self._sections:
                self._sections[title] = self.add_argument_group(title, about if self.everything else None)
            section, said = self._sections[title], entry.metadata
            if entry.name in getattr(kind, "either", ()):
                if either is None:
                    either = section.add_mutually_exclusive_group()
                section = either
            action = section.add_argument(*(said["names"] or [entry.name]), **_settings(entry))
            action.help = said["help"] if self.everything else _short(said["help"])
            action.metavar = said["metavar"]
            if said["rare"] and not self.everything:
                action.help = argparse.SUPPRESS

    def read(self, words: Sequence[str]) -> Any:
        """Return the options of a command line; wrong usage is one line, and exits."""
        if any(not word or (word.startswith("--") and word.endswith("=")) for word in words):
            self.error("an argument is empty; is it a variable that is not set?")  # or the current folder
        for word in words[: words.index("--")] if "--" in words else words:
            if re.match(r"-[^\d.]", word):
                self._refuse_unknown(word.partition("=")[0])
        if "--" in words:  # behind which argparse, as it mixes words and options, would read options
            at = words.index("--")
            files = (
                f"./{word}" if word.startswith("-") and word != "-" else word for word in words[at + 1 :]
            )
            words = [*words[:at], *files]
        values, unexpected = self._values(words)
        missing = [action for action in self._needed if values[action.dest] is None]
        if missing:
            names = ["/".join(action.option_strings) or str(action.metavar) for action in missing]
            self.error(f"name {', '.join(MEANT.get(name, name) for name in names)}")
        if unexpected:
            self.error(f"unexpected argument: {' '.join(unexpected)}")
        try:
            return _made(self.kind, values)
        except (ValueError, CameraError) as error:
            self.error(str(error))

    def _values(self, words: Sequence[str]) -> tuple[dict[str, Any], list[str]]:
        """Return the values of a command line by their names, and words that no option takes."""
        try:
            namespace, unexpected = self.parse_known_intermixed_args(words)
        except argparse.ArgumentError as error:
            name = "" if error.argument_name is None else f"{error.argument_name}: "
            self.error(f"{name}{error.message}")
        return vars(namespace), unexpected

    def _refuse_unknown(self, name: str) -> None:
        """Refuse a name that no option has, and propose a similar one; -out is not -o ut."""
        options = list(self._option_string_actions)
        similar = [option for option in options if len(name) > 2 and option.startswith((name, f"-{name}"))]
        if name in options or (name[:2] in options and not similar):
            return
        similar += get_close_matches(name, options, 1, MIN_LIKENESS)
        remedy = "".join(f"; did you mean {option}?" for option in similar[:1])
        self.error(f"{name} is not an option of {self.command}{remedy}")


def _place(entry: "Field[Any]") -> int:
    """Return the place of an option or a group in the help: what is a command's own comes first."""
    if not is_dataclass(entry.type):
        return 0
    title = split_docstring(entry.type)[0].lower()
    return 1 + (GROUPS.index(title) if title in GROUPS else len(GROUPS))


def _short(text: str) -> str:
    """Return the first words of an explanation, and the default."""
    default = DEFAULT.search(text)
    return SHORT.split(text)[0] + (f" ({default[1]})" if default else "")


def _settings(entry: Field[Any]) -> dict[str, Any]:
    """Return the arguments of argparse's add_argument."""
    kind, reader = get_args(entry.type) if get_origin(entry.type) is Annotated else (entry.type, None)
    readers = [READERS[part] for part in get_args(kind) or (kind,) if part in READERS]
    how: dict[str, Any] = {"type": reader or next(iter(readers), None)}
    if kind is bool:
        how = {"action": "store_false" if entry.default else "store_true"}
    elif kind == bool | None:
        how = {"action": BooleanOptionalAction}
    elif kind == list[str] | None:
        how |= {"action": "append"}
    if not entry.metadata["names"]:
        return how | ({"nargs": "+"} if kind == list[str] else {})
    if entry.default is MISSING:
        return how | {"dest": entry.name, "required": True}
    return how | {"dest": entry.name, "default": entry.default}


def _made(kind: Any, values: Mapping[str, Any]) -> Any:
    """Make a dataclass, with its groups, from parsed values; ValueError if it refuses one."""
    arguments = {
        entry.name: _made(entry.type, values) if is_dataclass(entry.type) else values[entry.name]
        for entry in fields(kind)
    }
    return kind(**arguments)
