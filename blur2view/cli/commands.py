"""The command line: ``blur2view estimate`` and the other commands.

It imports what reads arguments; the module of a command is imported when the command is chosen.
"""

import argparse
import io
import os
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from typing import Any

from blur2view import __version__
from blur2view.cli.parser import CommandParser, Layout, Parser
from blur2view.cli.terminal import EXIT_CODES, FAILED, INTERRUPTED, UNREAD, complain
from blur2view.errors import Blur2ViewError, system_error

COMMANDS = {
    "estimate": "tell how the camera moved while the shutter was open: F and, with intrinsics, E and the "
    "pose",
    "segment": "mark what moves by itself in photographs of a moving camera",
    "to-colmap": "write each photograph into a COLMAP database as two images, at shutter-open and "
    "shutter-close",
    "place": "add both views of each frame to COLMAP's model, after to-colmap --link",
    "recover": "put the blurred frames that COLMAP refused back into its model",
    "to-transforms": "write a COLMAP model with views for trainers of radiance fields (transforms.json)",
    "reconstruct": "make a scene of a blurred video: its frames with their poses, ready to train",
    "report": "write one HTML page that shows the results of photographs",
    "triage": "sort photographs by their blur, and choose the sharpest frames of a video",
}
DESCRIPTION = (
    "Use what motion blur tells: choose the sharpest frames of a video, put frames that COLMAP refused back "
    "into its model, let radiance fields know the blur, measure how fast the camera turned, mask what moves "
    "by itself, estimate F of a single photograph. "
    "'blur2view COMMAND --help' explains a command, and --help-all lists all of its options and files."
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, by default with the process's arguments; return one of the `EXIT_CODES`."""
    options: Any = None
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file name may hold any bytes
    try:
        if "_ARGCOMPLETE" in os.environ:  # a shell asks how a line may go on
            from blur2view.cli.completion import complete

            complete(COMMANDS, partial(command_parser, everything=True))
        try:
            options = parse(sys.argv[1:] if arguments is None else arguments)
            code: int = options.execute()
        except SystemExit as end:  # argparse ends after help or wrong usage
            code = int(end.code or 0)
        if sys.stdout is not None:  # None if the process was started without one
            sys.stdout.flush()  # a failure is caught here; at exit, Python would print a traceback
        return code
    except Blur2ViewError as error:
        complain(error)
    except (MemoryError, ImportError, RuntimeError) as error:
        complain(system_error(error, jobs=hasattr(options, "many")))
    except KeyboardInterrupt:
        complain(Blur2ViewError("interrupted"))
        return INTERRUPTED
    except OSError as error:
        if error.filename is None:  # the error is of stdout: the rest of it goes nowhere
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # its reader, for example head, has closed the pipe
            return UNREAD
        name = error.filename or "what is printed, or the current folder"
        why = f"cannot be used ({error.strerror}); check the path and its permissions"
        complain(Blur2ViewError(f"{name}: {why}"))
    return FAILED


def parse(words: Sequence[str]) -> Any:
    """Return the options of the command that the first word names; wrong usage prints one line and exits."""
    command = next(iter(words), "")
    if command in COMMANDS:
        return command_parser(command, everything="--help-all" in words).read(words[1:])
    parser = Parser(
        prog="blur2view", usage="blur2view COMMAND [OPTIONS]", description=DESCRIPTION, formatter_class=Layout
    )
    parser.add_argument("--help-all", action="help", help=argparse.SUPPRESS)
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    parser.add_table("commands", COMMANDS)
    parser.add_table("exit codes", EXIT_CODES)
    if not command:
        parser.print_help(sys.stdout)
        parser.exit()
    if command.startswith("-"):
        _, unexpected = parser.parse_known_args(words)
        parser.error(f"unexpected argument: {' '.join(unexpected)}")
    similar = "".join(f"; did you mean {name}?" for name in get_close_matches(command, COMMANDS, 1))
    parser.error(f"{command} is not a command{similar}")


def command_parser(command: str, *, everything: bool = False) -> CommandParser:
    """Return the parser of a command: for ``to-colmap`` it reads ToColmapOptions of cli/to_colmap.py."""
    module = import_module(f"blur2view.cli.{command.replace('-', '_')}")
    kind = getattr(module, f"{command.title().replace('-', '')}Options")
    return CommandParser(command, kind, everything=everything)
