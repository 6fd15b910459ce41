"""A command's parser, filled when it is chosen: two helps, errors of one line, completion in a shell."""

import argparse
import copy
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from blur2view.cli.terminal import printable

BRIEF = {
    *("recursive", "every", "output", "db", "link", "format", "csv", "keep", "max_smear", "blurred", "mask"),
    *("masks", "photographs", "dialect", "json", "verbosity", "focal", "camera", "exposure", "sequence"),
    *("extract", "best", "every_best", "in_order", "jobs", "resume", "help", "help_all"),
}
"""Options that ``--help`` shows, by the names that argparse keeps their values by."""
MESSAGES = {
    "^argument ": "",
    "^the following arguments are required: INPUT": "name photographs, a folder or a video",
    "^the following arguments are required: ": "name ",
    "invalid (int|float) value: ": "expected a number, got ",
    "expected one argument": "needs a value behind it",
    "not allowed with argument (.*)": r"does not go with \1; choose one of them",
    "invalid choice: (.*) \\(choose from (.*)\\)": r"expected one of \2, got \1",
}
"""What argparse says, and what we do."""


class CommandParser(argparse.ArgumentParser):
    """A parser whose options are described when it is used, so that other commands start faster.

    ``describe`` adds them. ``--help`` has those of `BRIEF` alone, in a few words each, and ``examples``;
    ``--help-all`` all, with what ``tables`` makes.
    """

    examples = ""

    def __init__(self, *, describe: Callable[["CommandParser"], None] | None = None, **settings: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **settings)
        self._describe = describe
        self.tables: Callable[[], list[str]] = list
        self._brief = describe is not None

    def described(self) -> "CommandParser":
        """Return the parser with its options."""
        if self._describe is not None:
            describe, self._describe = self._describe, None
            text = "show all options, files and JSON keys, and exit"
            self.add_argument("--help-all", nargs=0, action=HelpAll, help=text)
            describe(self)
            self.set_defaults(usage_error=self.error)
        return self

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Return the options as argparse does, after describing them."""
        return super(CommandParser, self.described()).parse_known_args(args, namespace)

    def format_help(self) -> str:
        """Return the help: of a command what matters most, until ``--help-all`` is asked for."""
        if not self._brief:
            return super().format_help()
        formatter = self._get_formatter()
        formatter.add_usage(None, [action for action in self._actions if not action.option_strings], [])
        formatter.add_text(self.description)
        formatter.start_section("options")
        for action in sorted(self._actions, key=lambda action: action.dest.startswith("help")):
            if action.dest in BRIEF or not action.option_strings:
                short = copy.copy(action)
                short.help = re.split(r"; |\. |, see below| \(default", action.help or "")[0]
                formatter.add_argument(short)
        formatter.end_section()
        formatter.add_text(self.examples)
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
        parser.epilog = "\n\n".join([*parser.tables(), parser.examples])
        print(argparse.ArgumentParser.format_help(parser), end="")
        parser.exit()


class Completion(argparse.Action):
    """The option ``--completion``."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: Any = None
    ) -> None:
        """Print the script of a shell and end the program."""
        import shtab

        if values not in shtab.SUPPORTED_SHELLS:
            parser.error(f"{option} knows {', '.join(shtab.SUPPORTED_SHELLS)}, not {values}")
        (commands,) = (one for one in parser._actions if isinstance(one, argparse._SubParsersAction))
        for command in commands.choices.values():
            for action in command.described()._actions:
                if not action.option_strings or action.type is output_path:
                    action.complete = shtab.FILE
        print(shtab.complete(parser, values))
        parser.exit()


def output_path(text: str) -> Path:
    """Return the path of what will be written."""
    if "\0" in text:
        raise argparse.ArgumentTypeError("a path has no null character")
    return Path(text)
