"""Options: dataclasses that commands are composed of, and their way to argparse and back.

A command is a frozen dataclass. Its docstring has a line for each of its fields, in their order, as the help
shows it: ``--every N: of a video take one frame in N``, and those below ``Rarely:`` in --help-all alone. The
field has type and default: a flag, a value, words that are repeated (``list[str] | None``), or an argument if
its line has no name; ``Annotated[float, convert]`` says what makes the value of a word. A field whose type is
a dataclass is a group of options that commands share: its docstring begins with the group's title and, behind
a colon, what stands above its options; those that it lists as ``either`` exclude each other.
"""

import argparse
import inspect
import re
import shutil
import sys
from argparse import BooleanOptionalAction
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, field, fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, NoReturn, get_args, get_origin

from blur2view.cli.terminal import EXIT_CODES, printable
from blur2view.cli.values import file_path, whole
from blur2view.errors import CameraError

CONVERT: dict[Any, Callable[[str], Any]] = {Path: file_path, int: whole(1), float: float}
"""What makes a value of a word, by the type of the field; ValueError or ArgumentTypeError of a wrong one."""
ENTRY, RARELY = re.compile(r"((?:-[\w-]+(?:, )?)*) ?([A-Z]*): (.*)"), "Rarely:"
SHORT = re.compile(r"; |\. |, see below| \(default")  # where the first words of an explanation end
ALIKE = 0.8  # of what was meant to what was written
MESSAGES = {
    "^argument ": "",
    "^the following arguments are required: INPUT": "name photographs, a folder or a video",
    "^the following arguments are required: ": "name ",
    "^unrecognized arguments: (.*)": r"\1 is too much; name one",
    r"invalid \w+ value: ": "expected a number, got ",
}
"""What argparse says, and what is printed."""


def group(kind: type) -> Any:
    """Return the field of a group of options, all as they are by default."""
    return field(default_factory=kind)


def described(kind: type) -> tuple[str, list[dict[str, Any]]]:
    """Return what a dataclass of options says of itself, and of each option: names, metavar, help, rare."""
    about: list[str] = []
    entries: list[dict[str, Any]] = []
    rare = False
    for line in inspect.cleandoc(kind.__doc__ or "").splitlines():
        if match := ENTRY.fullmatch(line):
            names = re.findall(r"[^, ]+", match[1])
            entries.append({"names": names, "metavar": match[2] or None, "help": match[3], "rare": rare})
        elif line == RARELY:
            rare = True
        elif entries:
            entries[-1]["help"] += f" {line.strip()}" * bool(line)
        else:
            about.append(line)
    return "\n".join(about).strip(), entries


class Layout(argparse.HelpFormatter):
    """As argparse has it, no wider than is read with ease; a text of several lines keeps them."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=min(max(shutil.get_terminal_size().columns, 60), 110) - 2)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if "\n" in text else super()._fill_text(text, width, indent)


class Parser(argparse.ArgumentParser):
    """A parser that says so where its help cannot be printed, and of wrong usage one line."""

    def _print_message(self, message: str, file: Any = None) -> None:
        (file or sys.stderr).write(message)

    def error(self, message: str) -> NoReturn:
        """Exit with one line, in which what a terminal would obey is written as escapes."""
        for said, printed in MESSAGES.items():
            message = re.sub(said, printed, message)
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
    of them, and the ``tables()`` of the command: titles with lines "name: explanation", or mappings of these.
    """

    def __init__(self, command: str, kind: Any, *, everything: bool = False) -> None:
        super().__init__(prog=f"blur2view {command}", formatter_class=Layout, allow_abbrev=False)
        self.command, self.kind, self.everything = command, kind, everything
        self.description = " ".join(described(kind)[0].partition("\n\n")[2].split())
        more = f"all options and files: {self.prog} --help-all"
        self.epilog = "\n  ".join(["examples:", *kind.examples]) + f"\n\n{more}" * (not everything)
        text = "show all options and files, and exit"
        self.add_argument("--help-all", action="help", help=text)
        self._sections: dict[str, Any] = {"options": self._optionals}
        self._add(kind)
        actions = [one for one in self._actions if one.required]
        needed = [(*one.option_strings[:1], f"{one.metavar}{'...' * (one.nargs == '+')}") for one in actions]
        self.usage = " ".join([self.prog, "[OPTIONS]", *(" ".join(one) for one in needed)])
        if everything:
            for title, rows in (kind.tables() | {"exit codes": EXIT_CODES}).items():
                self.add_table(title, rows)

    def _add(self, kind: Any) -> None:
        """Add the options of a dataclass and of its groups; all their names differ."""
        about, entries = described(kind)
        title, _, about = (
            about.removesuffix(".").partition(": ") if kind is not self.kind else ("options", "", "")
        )
        own, either = [one for one in fields(kind) if not is_dataclass(one.type)], None
        if own and title not in self._sections:
            text = f"{' '.join(about.split())}." if about and self.everything else None
            self._sections[title] = self.add_argument_group(title, text)
        for one, entry in zip(own, entries, strict=True):
            section = self._sections[title]
            if one.name in getattr(kind, "either", ()):
                section = either = either or section.add_mutually_exclusive_group()
            action = section.add_argument(*(entry["names"] or [one.name]), **_settings(one, entry["names"]))
            text = entry["help"] if self.everything else SHORT.split(entry["help"])[0]
            action.help = argparse.SUPPRESS if entry["rare"] and not self.everything else text
            action.metavar = entry["metavar"]
        for one in fields(kind):
            if is_dataclass(one.type):
                self._add(one.type)

    def read(self, words: Sequence[str]) -> Any:
        """Return the options that words state; wrong usage ends the program with one line."""
        if any(not word or (word.startswith("--") and word.endswith("=")) for word in words):
            self.error("an argument is empty; is it a variable that is not set?")  # or the current folder
        for word in words[: words.index("--")] if "--" in words else words:
            if re.match(r"-[^\d.]", word):
                self._refuse_unknown(word.partition("=")[0])
        if "--" in words:  # behind which argparse, as it mixes words and options, would read options
            at = words.index("--")
            files = (f"./{one}" if one[0] == "-" != one else one for one in words[at + 1 :])
            words = [*words[:at], *files]
        values = vars(self.parse_intermixed_args(words))
        try:
            return _made(self.kind, values)
        except (ValueError, CameraError) as error:
            self.error(str(error))

    def _refuse_unknown(self, name: str) -> None:
        """Refuse an option that is none, with the one that may be meant; -out is not -o ut."""
        options = list(self._option_string_actions)
        near = [one for one in options if len(name) > 2 and one.startswith((name, f"-{name}"))]
        if name in options or (name[:2] in options and not near):
            return
        near += get_close_matches(name, options, 1, ALIKE)
        remedy = "".join(f"; did you mean {one}?" for one in near[:1])
        self.error(f"{name} is no option of {self.command}{remedy}")


def _settings(one: Field[Any], names: Sequence[str]) -> dict[str, Any]:
    """Return how argparse reads an option of these names, an argument if it has none."""
    kind, convert = get_args(one.type) if get_origin(one.type) is Annotated else (one.type, None)
    converts = [CONVERT[part] for part in get_args(kind) or (kind,) if part in CONVERT]
    how: dict[str, Any] = {"type": convert or next(iter(converts), None)}
    if kind is bool:
        how = {"action": "store_false" if one.default else "store_true"}
    elif kind == bool | None:
        how = {"action": BooleanOptionalAction}
    elif kind == list[str] | None:
        how |= {"action": "append"}
    if not names:
        return how | ({"nargs": "+"} if kind == list[str] else {})
    needed = one.default is MISSING
    return how | {"dest": one.name} | ({"required": True} if needed else {"default": one.default})


def _made(kind: Any, values: Mapping[str, Any]) -> Any:
    """Return the dataclass of parsed values, with its groups; ValueError of what it refuses."""
    made = {
        one.name: _made(one.type, values) if is_dataclass(one.type) else values[one.name]
        for one in fields(kind)
    }
    return kind(**made)
