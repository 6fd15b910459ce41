"""Options: dataclasses that commands are composed of, and their way to argparse and back.

A command is a frozen dataclass. A field that `option` made is an option of its own; a field whose type is a
dataclass is a group of options that commands share, whose docstring is the group's title and, behind a colon,
what stands above its options. Defaults and helps stand in these fields alone.
"""

import argparse
import copy
import re
import shutil
from argparse import BooleanOptionalAction
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, field, fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn, get_args

from blur2view.cli.terminal import printable
from blur2view.cli.values import file_path, whole
from blur2view.errors import CameraError

CONVERT: dict[Any, Callable[[str], Any]] = {Path: file_path, int: whole(1), float: float}
"""What makes a value of a word, by the type of the field; ValueError or ArgumentTypeError of a wrong one."""
ALIKE = 0.8  # of what was meant to what was written
MESSAGES = {
    "^argument ": "",
    "^the following arguments are required: INPUT": "name photographs, a folder or a video",
    "^the following arguments are required: ": "name ",
    r"invalid \w+ value: ": "expected a number, got ",
}
"""What argparse says, and what is printed."""
EXIT_CODES = """
0: done; a photograph without F is a result, with its reason
1: something failed: one line on stderr each, other photographs are done all the same
2: wrong usage
130: interrupted by Ctrl-C: what is done is kept, --resume goes on
141: what read the output wants no more of it, as head does; the rest is not done
"""


def option(
    default: Any,
    help: str,
    metavar: str | None = None,
    *,
    names: str = "",
    either: str = "",
    convert: Callable[[str], Any] | None = None,
    choices: Sequence[str] | None = None,
    rare: bool = False,
) -> Any:
    """Return the field of an option.

    It is called ``names``, by default --NAME, a flag that is true without it --no-NAME, and one that may also
    be None both; one of None or words may be repeated; without a default (`MISSING`) and names it is an
    argument. Options with one word of ``either`` exclude each other. ``convert`` is by default that of
    `CONVERT`. What is ``rare`` stands in --help-all alone.
    """
    shown = {"help": " ".join(help.split()), "metavar": metavar, "choices": choices}
    metadata = {"names": names.split(), "either": either, "convert": convert, "rare": rare, "shown": shown}
    return field(default=default, metadata=metadata)


def group(kind: type) -> Any:
    """Return the field of a group of options, all as they are by default."""
    return field(default_factory=kind)


def values_of(options: Any) -> Iterator[tuple[str, Any]]:
    """Yield the names and values of a command's options, groups resolved."""
    for one in fields(options):
        value = getattr(options, one.name)
        if is_dataclass(one.type):
            yield from values_of(value)
        elif "shown" in one.metadata:
            yield one.name, value


class Layout(argparse.HelpFormatter):
    """As argparse has it, no wider than is read with ease; a text of several lines keeps them."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=min(max(shutil.get_terminal_size().columns, 60), 110) - 2)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if "\n" in text else super()._fill_text(text, width, indent)


class CommandParser(argparse.ArgumentParser):
    """The parser of a command's dataclass.

    ``--help`` has the options that are not rare, in a few words each, and the examples; ``--help-all`` all,
    and the ``tables()`` of the command: titles with lines "name: explanation", or mappings of these.
    """

    def __init__(self, command: str, kind: Any) -> None:
        super().__init__(prog=f"blur2view {command}", formatter_class=Layout, allow_abbrev=False)
        self.command, self.kind = command, kind
        self.description = " ".join(kind.__doc__.partition("\n\n")[2].split())
        self.epilog = "\n  ".join(["examples:", *kind.examples])
        text = "show all options, files and JSON keys, and exit"
        self.add_argument("--help-all", nargs=0, action=_HelpAll, help=text)
        self._sections: dict[str, Any] = {}
        self._add(kind, "options", "")

    def _add(self, kind: Any, title: str, place: str) -> None:
        """Add the options of a dataclass, of which the names of values begin with a ``place``."""
        for one in fields(kind):
            if is_dataclass(one.type):
                self._add(one.type, " ".join((one.type.__doc__ or "").split()), f"{place}{one.name}.")
            elif "shown" in one.metadata:
                self._add_option(one, title, f"{place}{one.name}")

    def _add_option(self, one: Field[Any], title: str, dest: str) -> None:
        name, _, about = title.rstrip(".").partition(": ")
        either = one.metadata["either"]
        if name not in self._sections:
            self._sections[name] = self.add_argument_group(name, f"{about}." if about else None)
        if either and either not in self._sections:
            self._sections[either] = self._sections[name].add_mutually_exclusive_group()
        names, settings = _settings(one, dest)
        action = self._sections[either or name].add_argument(*names, **settings)
        vars(action).update(one.metadata["shown"], rare=one.metadata["rare"])

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
        many = [
            dest for dest, value in values.items() if dest.endswith(".images") and isinstance(value, list)
        ]
        if unknown and not many:
            self.error(f"{' '.join(unknown)} is too much; name one")
        for dest in many:  # argparse takes those on one side of an option alone
            values[dest] = [*values[dest], *unknown]
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


def _settings(one: Field[Any], dest: str) -> tuple[list[str], dict[str, Any]]:
    """Return what argparse must know to read an option: its names, and how."""
    needed, names, flag = one.default is MISSING, one.metadata["names"], one.name.replace("_", "-")
    kinds = get_args(one.type) or (one.type,)
    convert = one.metadata["convert"] or next((CONVERT[kind] for kind in kinds if kind in CONVERT), None)
    how: dict[str, Any] = {"type": convert}
    if one.type is bool:
        how = {"action": "store_false" if one.default else "store_true"}
        flag = f"no-{flag}" if one.default else flag
    elif one.type == bool | None:
        how = {"action": BooleanOptionalAction}
    elif one.type == list[str] | None:
        how = {"action": "append"}
    if needed and not names:
        return [dest], how | ({"nargs": "+"} if one.type == list[str] else {})
    how |= {"required": True} if needed else {"default": one.default}
    return names or [f"--{flag}"], how | {"dest": dest}


def _made(kind: Any, values: Mapping[str, Any], place: str) -> Any:
    """Return the dataclass of parsed values, with its groups; ValueError of what it refuses."""
    return kind(
        **{
            one.name: _made(one.type, values, f"{place}{one.name}.")
            if is_dataclass(one.type)
            else values[f"{place}{one.name}"]
            for one in fields(kind)
            if is_dataclass(one.type) or "shown" in one.metadata
        }
    )
