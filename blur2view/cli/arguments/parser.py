"""A command's parser, filled when it is chosen: two helps, errors of one line, completion in a shell."""

import argparse
import copy
import re
import shutil
from importlib import import_module
from typing import Any, NoReturn

from blur2view.cli.arguments.option import Options, Rows, add_options, declared, texts
from blur2view.cli.arguments.values import file_path
from blur2view.cli.terminal import printable
from blur2view.errors import CameraError

EXIT_CODES = """
0: done; a photograph without F is a result, with its reason
1: something failed: one line on stderr each, other photographs are done all the same
2: wrong usage
130: interrupted by Ctrl-C: what is done is kept, --resume goes on
141: what read the output wants no more of it, as head does; the rest is not done
"""
MESSAGES = {
    "^argument ": "",
    "^the following arguments are required: INPUT": "name photographs, a folder or a video",
    "^the following arguments are required: ": "name ",
    r"invalid \w+ value: ": "expected a number, got ",
}
"""What argparse says, and what we do."""


class Layout(argparse.HelpFormatter):
    """As argparse has it, no wider than is read with ease; a text of several lines keeps them."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=min(max(shutil.get_terminal_size().columns, 60), 110) - 2)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if "\n" in text else super()._fill_text(text, width, indent)


def add_table(parser: Any, title: str, rows: Rows) -> None:
    """Add a titled list to what the help shows below the options: of a text, or of a document its keys.

    A text has lines as "name: explanation", of which further ones are indented.
    """
    if isinstance(rows, str):
        rows = dict(line.split(": ", 1) for line in re.sub(r"\n +", " ", rows).splitlines() if line)
    group = parser.add_argument_group(title)
    for name, text in rows.explanations() if isinstance(rows, type) else rows.items():
        group._group_actions.append(argparse.Action([], "", metavar=name, help=text.replace("%", "%%")))


class CommandParser(argparse.ArgumentParser):
    """A parser with the options of a command's dataclass, which is imported when it is used.

    ``--help`` has those that are not rare, in a few words each, and the examples; ``--help-all`` all, and the
    tables.
    """

    def __init__(self, *, command: str = "", **settings: Any) -> None:
        super().__init__(formatter_class=Layout, allow_abbrev=False, **settings)
        self.command = command
        self.kind: type[Options] | None = None

    def of(self, kind: type[Options]) -> "CommandParser":
        """Return the parser with the options of a command."""
        self.kind = kind
        self.description = " ".join((kind.__doc__ or "").partition("\n\n")[2].split())
        self.epilog = "\n  ".join(["examples:", *kind.examples])
        text = "show all options, files and JSON keys, and exit"
        self.add_argument("--help-all", nargs=0, action=HelpAll, help=text)
        add_options(self, kind)
        self.set_defaults(parser=self)
        return self

    def filled(self) -> "CommandParser":
        """Return the parser with the options of its command: of ``to-colmap`` ToColmapOptions."""
        if not self.command or self.kind is not None:
            return self
        module = import_module(f"blur2view.cli.{self.command.replace('-', '_')}")
        return self.of(getattr(module, f"{self.command.title().replace('-', '')}Options"))

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Return the options as argparse does."""
        return super(CommandParser, self.filled()).parse_known_args(args, namespace)

    def read(self, parsed: argparse.Namespace) -> Options:
        """Return the options of the command; what they refuse is a usage error."""
        kind = self.kind or Options
        try:
            return kind(**{one.name: getattr(parsed, one.name) for one in declared(kind)})
        except (ValueError, CameraError) as error:
            self.error(str(error))

    def explained(self) -> "CommandParser":
        """Return the parser, whose options now have their texts: to read these off the source takes time."""
        explanations = {} if self.kind is None else texts(self.kind)
        for action in self._actions:
            action.help = explanations.get(action.dest, action.help)
        return self

    def format_help(self) -> str:
        """Return the help: of a command what matters most, until ``--help-all`` is asked for."""
        if self.kind is None:
            return super().format_help()
        formatter = self.explained()._get_formatter()
        others = argparse.Action([], "", metavar="[OPTIONS]")
        needed = [action for action in self._actions if action.required]
        formatter.add_usage(None, [others, *needed], [])
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
        for argparses, ours in MESSAGES.items():
            message = re.sub(argparses, ours, message)
        self.exit(2, f"{self.prog}: {printable(message)} (see {self.prog} --help)\n")


class HelpAll(argparse.Action):
    """The option ``--help-all``."""

    def __call__(self, parser: Any, *_: Any) -> None:
        """Print everything and end the program."""
        for title, rows in (parser.kind.tables | {"exit codes": EXIT_CODES}).items():
            add_table(parser, title, rows)
        print(argparse.ArgumentParser.format_help(parser.explained()), end="")
        parser.exit()


class Completion(argparse.Action):
    """The option ``--completion``."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: str | None = None) -> None:
        """Print the script of a shell and end the program."""
        import shtab

        (commands,) = (one for one in parser._actions if isinstance(one, argparse._SubParsersAction))
        for command in commands.choices.values():
            about = command.filled().explained().description
            command.description = about.partition(". ")[0]  # zsh has room for no more
            for action in command._actions:
                if not action.option_strings or action.type is file_path:
                    action.complete = shtab.FILE
        print(shtab.complete(parser, values))
        parser.exit()
