"""Options: dataclasses that commands are composed of, and their way to argparse and back.

A command is a frozen dataclass. Its docstring has a line for each of its fields, in their order, as the help
shows it: ``--every N: of a video take one frame in N``, and those below ``Rarely:`` in --help-all alone. The
field has type and default: a flag, a value, words that are repeated (``list[str] | None``), or an argument if
its line has no name; ``Annotated[float, convert]`` says what makes the value of a word. A field whose type is
a dataclass is a group of options that commands share: its docstring begins with the group's title and, behind
a colon, what stands above its options; those that it lists as ``either`` exclude each other.
"""

import argparse
import copy
import inspect
import re
import shutil
import sys
from argparse import BooleanOptionalAction
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, NoReturn, get_args, get_origin

from blur2view.cli.terminal import EXIT_CODES, printable
from blur2view.cli.values import file_path, whole
from blur2view.errors import CameraError

CONVERT: dict[Any, Callable[[str], Any]] = {Path: file_path, int: whole(1), float: float}
"""What makes a value of a word, by the type of the field; ValueError or ArgumentTypeError of a wrong one."""
ENTRY, RARELY = re.compile(r"((?:-[\w-]+(?:, )?)*) ?([A-Z]*): (.*)"), "Rarely:"
INPUTS = "common.reading.images"  # where the words are found that may stand on both sides of options
ALIKE = 0.8  # of what was meant to what was written
MESSAGES = {
    "^argument ": "",
    "^the following arguments are required: INPUT": "name photographs, a folder or a video",
    "^the following arguments are required: ": "name ",
    r"invalid \w+ value: ": "expected a number, got ",
}
"""What argparse says, and what is printed."""


def group(kind: type) -> Any:
    """Return the field of a group of options, all as they are by default."""
    return field(default_factory=kind)


@dataclass(kw_only=True)
class Entry:
    """What a docstring says of an option."""

    names: list[str]
    metavar: str
    help: str
    rare: bool


def described(kind: type) -> tuple[str, list[Entry]]:
    """Return what a dataclass of options says of itself, and of each option."""
    about: list[str] = []
    entries: list[Entry] = []
    rare = False
    for line in inspect.cleandoc(kind.__doc__ or "").splitlines():
        if match := ENTRY.fullmatch(line):
            names, metavar, text = match.groups()
            entries.append(Entry(names=re.findall(r"[^, ]+", names), metavar=metavar, help=text, rare=rare))
        elif line == RARELY:
            rare = True
        elif entries:
            entries[-1].help += f" {line.strip()}" * bool(line)
        else:
            about.append(line)
    return "\n".join(about).strip(), entries


class Layout(argparse.HelpFormatter):
    """As argparse has it, no wider than is read with ease; a text of several lines keeps them."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=min(max(shutil.get_terminal_size().columns, 60), 110) - 2)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if "\n" in text else super()._fill_text(text, width, indent)


class PrintingParser(argparse.ArgumentParser):
    """A parser that says so where its help cannot be printed."""

    def _print_message(self, message: str, file: Any = None) -> None:
        (file or sys.stderr).write(message)


class CommandParser(PrintingParser):
    """The parser of a command's dataclass.

    ``--help`` has the options that are not rare, in a few words each, and the examples; ``--help-all`` all,
    and the ``tables()`` of the command: titles with lines "name: explanation", or mappings of these.
    """

    def __init__(self, command: str, kind: Any) -> None:
        super().__init__(prog=f"blur2view {command}", formatter_class=Layout, allow_abbrev=False)
        self.command, self.kind = command, kind
        self.description = " ".join(described(kind)[0].partition("\n\n")[2].split())
        self.epilog = "\n  ".join(["examples:", *kind.examples])
        text = "show all options, files and JSON keys, and exit"
        self.add_argument("--help-all", nargs=0, action=_HelpAll, help=text)
        self._sections: dict[str, Any] = {}
        self._add(kind, "")

    def _add(self, kind: Any, place: str) -> None:
        """Add the options of a dataclass, whose values are found at a ``place`` in the command."""
        about, entries = described(kind)
        title, _, about = about.removesuffix(".").partition(": ") if place else ("options", "", "")
        own = [one for one in fields(kind) if not is_dataclass(one.type)]
        if own and title not in self._sections:
            text = f"{' '.join(about.split())}." if about else None
            self._sections[title] = self.add_argument_group(title, text)
        either = None
        for one, entry in zip(own, entries, strict=True):
            section = self._sections[title]
            if one.name in getattr(kind, "either", ()):
                section = either = either or section.add_mutually_exclusive_group()
            names, settings = _settings(one, entry, f"{place}{one.name}")
            action = section.add_argument(*names, **settings)
            vars(action).update(help=entry.help, metavar=entry.metavar or None, rare=entry.rare)
        for one in fields(kind):
            if is_dataclass(one.type):
                self._add(one.type, f"{place}{one.name}.")

    def read(self, words: Sequence[str]) -> Any:
        """Return the options that words state; wrong usage ends the program with one line."""
        if any(not word or (word.startswith("--") and word.endswith("=")) for word in words):
            self.error("an argument is empty; is it a variable that is not set?")  # or the current folder
        parsed, unknown = self.parse_known_args(words)
        values = vars(parsed)
        names = list(self._option_string_actions)
        before = list(words)[: list(words).index("--")] if "--" in words else words
        for word in (word.partition("=")[0] for word in before if word[0] == "-" != word):
            near = [name for name in names if len(word) > 2 and name.startswith((word, f"-{word}"))]
            near = [] if word in names else near  # -out is no -o ut
            if near or any(other.partition("=")[0] == word for other in unknown):
                near += get_close_matches(word, names, 1, ALIKE)
                remedy = "".join(f"; did you mean {name}?" for name in near[:1])
                self.error(f"{word} is no option of {self.command}{remedy}")
        if unknown and INPUTS not in values:
            self.error(f"{' '.join(unknown)} is too much; name one")
        if unknown:  # argparse takes those on one side of an option alone
            values[INPUTS] = [*values[INPUTS], *unknown]
        try:
            return _made(self.kind, values, "")
        except (ValueError, CameraError) as error:
            self.error(str(error))

    def format_help(self) -> str:
        """Return the help on what matters most."""
        formatter = self._get_formatter()
        others = argparse.Action([], "", metavar="[OPTIONS]")
        formatter.add_usage(None, [others, *(action for action in self._actions if action.required)], [])
        formatter.add_text(self.description)
        formatter.start_section("options")
        for action in sorted(self._actions, key=lambda action: action.dest.startswith("help")):
            if not getattr(action, "rare", False):
                short = copy.copy(action)
                short.help = re.split(r"; |\. |, see below| \(default", action.help or "")[0]
                formatter.add_argument(short)
        formatter.end_section()
        formatter.add_text(self.epilog)
        formatter.add_text(f"all options, files and JSON keys: {self.prog} --help-all")
        return formatter.format_help()

    def error(self, message: str) -> NoReturn:
        """Exit with one line, in which what a terminal would obey is written as escapes."""
        for said, printed in MESSAGES.items():
            message = re.sub(said, printed, message)
        self.exit(2, f"{self.prog}: {printable(message)} (see {self.prog} --help)\n")


class _HelpAll(argparse.Action):
    """The option ``--help-all``."""

    def __call__(self, parser: Any, *_: Any) -> None:
        """Print everything and end the program."""
        for title, rows in (parser.kind.tables() | {"exit codes": EXIT_CODES}).items():
            add_table(parser, title, rows)
        print(argparse.ArgumentParser.format_help(parser), end="")
        parser.exit()


def add_table(parser: Any, title: str, rows: str | Mapping[str, str]) -> None:
    """Add a titled list to what the help shows below the options; further lines of a row are indented."""
    if isinstance(rows, str):
        rows = dict(line.split(": ", 1) for line in re.sub(r"\n +", " ", rows).splitlines() if line)
    section = parser.add_argument_group(title)
    for name, text in rows.items():
        section._group_actions.append(argparse.Action([], "", metavar=name, help=text.replace("%", "%%")))


def _settings(one: Field[Any], entry: Entry, dest: str) -> tuple[list[str], dict[str, Any]]:
    """Return what argparse must know to read an option: its names, and how."""
    kind, convert = get_args(one.type) if get_origin(one.type) is Annotated else (one.type, None)
    kinds, needed = get_args(kind) or (kind,), one.default is MISSING
    how: dict[str, Any] = {
        "type": convert or next((CONVERT[part] for part in kinds if part in CONVERT), None)
    }
    if kind is bool:
        how = {"action": "store_false" if one.default else "store_true"}
    elif kind == bool | None:
        how = {"action": BooleanOptionalAction}
    elif kind == list[str] | None:
        how |= {"action": "append"}
    if not entry.names:
        return [dest], how | ({"nargs": "+"} if kind == list[str] else {})
    how |= {"required": True} if needed else {"default": one.default}
    return entry.names, how | {"dest": dest}


def _made(kind: Any, values: Mapping[str, Any], place: str) -> Any:
    """Return the dataclass of parsed values, with its groups; ValueError of what it refuses."""
    return kind(
        **{
            one.name: _made(one.type, values, f"{place}{one.name}.")
            if is_dataclass(one.type)
            else values[f"{place}{one.name}"]
            for one in fields(kind)
        }
    )
