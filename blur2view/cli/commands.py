"""The command line: ``blur2view estimate`` and the other commands.

Only what is needed to read the arguments is imported here; each command imports the rest when it runs.
"""

import argparse
import io
import os
import sys
from collections.abc import Sequence
from importlib import import_module

from blur2view import __version__
from blur2view.cli.arguments import estimate, place, report, segment, to_colmap, to_transforms, triage
from blur2view.cli.arguments.shared import EXIT_CODES, CommandParser, paragraph, table
from blur2view.cli.terminal import complain
from blur2view.errors import Blur2ViewError

DONE, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130
COMMANDS = {
    "estimate": estimate,
    "segment": segment,
    "to-colmap": to_colmap,
    "place": place,
    "to-transforms": to_transforms,
    "report": report,
    "triage": triage,
}
DESCRIPTION = """
One motion-blurred photograph in, the two-view geometry of the camera's motion during the exposure out.
blur2view COMMAND --help explains the options, files and JSON keys of a command.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Return the exit code of the command line, after running it.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the process by default.

    Returns
    -------
    int
        0 done (a degenerate scene is a result), 1 a named error, 2 usage, 130 interrupted.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file name may hold anything
    try:
        code = run(parse(arguments))
        if sys.stdout is not None:  # None if the process was started without one
            sys.stdout.flush()  # a failure is caught here; at exit Python would print a traceback
    except Blur2ViewError as error:
        complain(error)
        return FAILED
    except KeyboardInterrupt:
        print("blur2view: interrupted", file=sys.stderr)
        return INTERRUPTED
    except OSError as error:
        if error.filename is not None:  # no stream
            reason = f"{error.strerror}; check the path and its permissions"
            complain(Blur2ViewError(f"{error.filename}: cannot be used ({reason})"))
            return FAILED
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):  # whose reader, for example head, wants no more
            print(f"blur2view: cannot print ({error.strerror}); print elsewhere", file=sys.stderr)
        return FAILED
    return code


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options; wrong usage ends the program, an option of another command with a word about it."""
    parser = build_parser()
    options: argparse.Namespace
    options, unknown = parser.parse_known_args(arguments)
    for name in (word.partition("=")[0] for word in unknown if word.startswith("-")):
        if name in option_names(options.command):
            parser.error(f"{name} goes after {options.command}")
        if why := getattr(COMMANDS[options.command], "REFUSED", {}).get(name):
            parser.error(f"{name} is not for {options.command}: {why}")
        if owners := [f"blur2view {command}" for command in COMMANDS if name in option_names(command)]:
            parser.error(f"{name} is an option of {', '.join(owners)}, not of {options.command}")
    if unknown:
        parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    return options


def option_names(command: str) -> set[str]:
    """Return the names of a command's options."""
    parser = CommandParser()
    COMMANDS[command].describe(parser)
    return {name for action in parser._actions for name in action.option_strings}


def run(parsed: argparse.Namespace) -> int:
    """Return the exit code of a command; what it needs is imported only now."""
    from blur2view.cli.options import read_options

    command = import_module(f"blur2view.cli.{parsed.command.replace('-', '_')}")
    return int(command.run(read_options(parsed)))


def build_parser() -> CommandParser:
    """Return the parser; its defaults are those of the option dataclasses."""
    parser = CommandParser(
        prog="blur2view",
        description=paragraph(DESCRIPTION),
        epilog=table("exit codes", EXIT_CODES),
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(
        title="commands", dest="command", required=True, metavar="COMMAND", parser_class=CommandParser
    )
    for name, command in COMMANDS.items():
        commands.add_parser(name, help=command.ABOUT, describe=command.describe)
    return parser
