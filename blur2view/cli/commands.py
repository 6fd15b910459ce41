"""The command line: ``blur2view estimate`` and the other commands.

Only what is needed to read the arguments is imported here; a command's module is when it is chosen.
"""

import argparse
import errno
import io
import os
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import Any

from blur2view import __version__
from blur2view.cli.adapter import CommandParser, Layout, PrintingParser, add_table
from blur2view.cli.terminal import EXIT_CODES, FAILED, INTERRUPTED, UNREAD, complain, printable
from blur2view.errors import Blur2ViewError

NO_MEMORY = "failed to map", "start new thread", "allocate memory"  # in errors of Python's
COMMANDS = {
    "estimate": "say what the camera did while the shutter was open: F, with intrinsics E and the pose",
    "segment": "segment what moves by itself from what the camera's motion explains",
    "to-colmap": "write each photograph as two virtual images, at shutter-open and shutter-close, for COLMAP",
    "place": "put the views of a linked project into COLMAP's model of its frames",
    "recover": "register the frames of a video that COLMAP's model lacks, as they are too blurred for it",
    "to-transforms": "write a COLMAP model with views as transforms.json, for radiance fields of blurred "
    "photographs",
    "report": "write one HTML page that shows the result of each photograph",
    "triage": "sort photographs by their blur: sharp, moved but of use, out of focus, unclear, unusable",
}
DESCRIPTION = (
    "One motion-blurred photograph in, the two-view geometry of the camera's motion during the exposure out. "
    "blur2view COMMAND --help explains a command, --help-all all its options, files and JSON keys."
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Return the exit code of the command line, after running it; its words are the process's by default.

    0: done (a degenerate scene is a result), 1: a named error, 2: usage, 130: interrupted, 141: nobody reads
    any more what is printed.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file name may hold anything
    try:
        try:
            code: int = parse(sys.argv[1:] if arguments is None else arguments).execute()
        except SystemExit as end:  # of argparse, after a help or wrong usage
            code = int(end.code or 0)
        if sys.stdout is not None:  # None if the process was started without one
            sys.stdout.flush()  # a failure is caught here; at exit Python would print a traceback
    except Blur2ViewError as error:
        complain(error)
        return FAILED
    except (MemoryError, ImportError, RuntimeError) as error:
        if not isinstance(error, MemoryError) and not any(word in str(error) for word in NO_MEMORY):
            raise
        complain(Blur2ViewError("too little memory; free some, or add --jobs 1"))
        return FAILED
    except KeyboardInterrupt:
        print("blur2view: interrupted", file=sys.stderr)
        return INTERRUPTED
    except OSError as error:
        return _stream_failed(error)
    return code


def _stream_failed(error: OSError) -> int:
    """Return the exit code, after a line about a file or a stream that cannot be used."""
    if error.filename is not None or error.errno in (errno.EMFILE, errno.ENFILE):  # no stream
        reason = f"{error.strerror}; check the path, its permissions and limits (ulimit)"
        complain(Blur2ViewError(f"{error.filename or 'a file'}: cannot be used ({reason})"))
        return FAILED
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):  # its reader, for example head, wants no more
        return UNREAD
    print(f"blur2view: cannot print ({error.strerror}); print elsewhere", file=sys.stderr)
    return FAILED


def parse(words: Sequence[str]) -> Any:
    """Return the options of the command that words name; wrong usage ends the program with one line.

    Blur2ViewError where the current folder is gone.
    """
    try:
        os.getcwd()
    except OSError:
        raise Blur2ViewError("the current folder is not there any more; change to another one") from None
    command = next(iter(words), "")
    if command in COMMANDS:
        return parser_of(command).read(words[1:])
    parser = _Overview()
    if command.startswith("-"):
        parser.parse_args(words)
    near = "".join(f"; did you mean {one}?" for one in get_close_matches(command, COMMANDS, 1))
    parser.error(f"{command} is no command{near}" if command else "name a command")


def parser_of(command: str) -> CommandParser:
    """Return the parser of a command: of ``to-colmap`` that of ToColmapOptions, in its own module."""
    module = import_module(f"blur2view.cli.{command.replace('-', '_')}")
    return CommandParser(command, getattr(module, f"{command.title().replace('-', '')}Options"))


class _Overview(PrintingParser):
    """What says which commands there are."""

    def __init__(self) -> None:
        usage = "blur2view COMMAND [OPTIONS]"
        super().__init__(prog="blur2view", usage=usage, description=DESCRIPTION, formatter_class=Layout)
        self.add_argument("--help-all", action="help", help=argparse.SUPPRESS)
        self.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
        add_table(self, "commands", COMMANDS)
        add_table(self, "exit codes", EXIT_CODES)

    def error(self, message: str) -> Any:
        """Exit with one line."""
        self.exit(2, f"blur2view: {printable(message)} (see blur2view --help)\n")
