"""Completion of commands, options and their values in a shell, by argcomplete (the extra ``completion``)."""

import argparse
import os
import sys
from collections.abc import Callable, Mapping

from blur2view.cli.parser import SHORT, OneOf

ASKED = "_ARGCOMPLETE"  # the shell's question: it counts the words before those that a parser reads


def complete(commands: Mapping[str, str], command_parser: Callable[[str], argparse.ArgumentParser]) -> None:
    """Print what may stand where the shell's cursor is, and end the process.

    A process without argcomplete, or without a line to complete, ends with the exit code 1, so that a command
    is not run by mistake.
    """
    try:
        import argcomplete

        _, _, _, words, _ = argcomplete.split_line(os.environ["COMP_LINE"], int(os.environ["COMP_POINT"]))
        first = int(os.environ[ASKED])
    except (ImportError, KeyError, ValueError):
        sys.exit(1)
    parser: argparse.ArgumentParser
    if len(words) > first and words[first] in commands:
        parser = command_parser(words[first])
        os.environ[ASKED] = str(first + 1)
    else:
        parser = argparse.ArgumentParser()
        parser.add_argument("--help-all", action="help")
        parser.add_argument("--version", action="version")
        parser.add_argument("command", choices=list(commands))
    for action in parser._actions:
        action.help = SHORT.split(action.help or "")[0]  # zsh shows it
        if isinstance(action.type, OneOf):
            vars(action)["completer"] = argcomplete.ChoicesCompleter(action.type.names)
    argcomplete.autocomplete(parser, always_complete_options="long")
