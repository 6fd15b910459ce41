"""The command line: ``blur2view estimate`` and the other commands.

Only what is needed to read the arguments is imported here; a command's module is when it is chosen.
"""

import argparse
import io
import os
import sys
from collections.abc import Sequence
from difflib import get_close_matches

from blur2view import __version__
from blur2view.cli.arguments.option import Options
from blur2view.cli.arguments.parser import EXIT_CODES, CommandParser, Completion, add_table
from blur2view.cli.terminal import complain
from blur2view.errors import Blur2ViewError

FAILED, INTERRUPTED, UNREAD = 1, 130, 141
COMMANDS = {
    "estimate": "say what the camera did while the shutter was open: F, with intrinsics E and the pose",
    "segment": "segment what moves by itself from what the camera's motion explains",
    "to-colmap": "write each photograph as two virtual images, at shutter-open and shutter-close, for COLMAP",
    "place": "put the views of a linked project into COLMAP's model of its frames",
    "to-transforms": "write a COLMAP model with views as transforms.json, for radiance fields of blurred "
    "photographs",
    "report": "write one HTML page that shows the result of each photograph",
    "triage": "sort photographs by their blur: sharp, moved but of use, out of focus, unclear, unusable",
}
SHELLS = ("bash", "zsh", "tcsh")
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
        code = parse(arguments).execute()
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
        if isinstance(error, BrokenPipeError):  # its reader, for example head, wants no more
            return UNREAD
        print(f"blur2view: cannot print ({error.strerror}); print elsewhere", file=sys.stderr)
        return FAILED
    return code


def parse(arguments: Sequence[str] | None) -> Options:
    """Return the options; wrong usage ends the program with one line."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    parser = build_parser()
    if any(not word or (word.startswith("--") and word.endswith("=")) for word in words):
        parser.error("an argument is empty; is it a variable that is not set?")  # or the current folder
    parsed, unknown = parser.parse_known_args(words)
    command: CommandParser = parsed.parser
    names = list(command._option_string_actions)
    for word in (word.partition("=")[0] for word in words if word[0] == "-" != word):
        near = [name for name in names if len(word) > 2 and name.startswith(f"-{word}")]  # -out is no -o ut
        if near or any(other.partition("=")[0] == word for other in unknown):
            near += get_close_matches(word, names, 1)
            remedy = "".join(f"; did you mean {name}?" for name in near[:1])
            command.error(f"{word} is no option of {command.command}{remedy}")
    if "images" in parsed:
        parsed.images += unknown  # argparse takes those on one side of an option alone
    elif unknown:
        command.error(f"{' '.join(unknown)} is too much; name one")
    return command.read(parsed)


def build_parser() -> CommandParser:
    """Return the parser; its defaults are those of the option dataclasses."""
    parser = CommandParser(prog="blur2view", description=DESCRIPTION)
    parser.add_argument(
        "--completion",
        metavar="SHELL",
        choices=SHELLS,
        action=Completion,
        help="print what completes commands and options in bash, zsh or tcsh; in ~/.bashrc: "
        'eval "$(blur2view --completion bash)"',
    )
    parser.add_argument("--help-all", action="help", help=argparse.SUPPRESS)
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(
        title="commands", dest="command", required=True, metavar="COMMAND", parser_class=CommandParser
    )
    for name, about in COMMANDS.items():
        commands.add_parser(name, help=about, command=name)
    add_table(parser, "exit codes", EXIT_CODES)
    return parser
