"""The command line: ``blur2view estimate`` and the other commands.

Only what is needed to read the arguments is imported here; each command imports the rest when it runs.
"""

import argparse
import io
import os
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from itertools import pairwise

from blur2view import __version__
from blur2view.cli.arguments.option import Options, refusals
from blur2view.cli.arguments.parser import EXIT_CODES, CommandParser, Completion, add_table, options_of
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
COMPLETION = "--completion"
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


MEANT = {
    "-i --input --inputs --image --images --photos --files": "the names of photographs alone",
    "--list --file-list": "@LIST, a file of names",
    "--gpu --cuda --device --use-gpu": "--provider cuda",
    "--threads --workers --num-workers -j": "--jobs",
    "--intrinsics --calib --calibration -K": "--camera",
    "--fps --stride --step --skip": "--every",
    "--exif": "--camera exif",
}
"""What other programs call options, and ours."""


def parse(arguments: Sequence[str] | None) -> Options:
    """Return the options; wrong usage ends the program with one line, which names what may be meant."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    parser = build_parser()
    check_empty(parser, words)
    check_command(parser, words)
    parsed, unknown = parser.parse_known_args(words)
    command: CommandParser = parsed.parser
    for word in (word for word in [*unknown, *words] if word.startswith("-")):
        check_option(command, word.partition("=")[0], known=word not in unknown)
    if "images" in parsed:
        parsed.images += unknown  # argparse takes those on one side of an option alone
    elif unknown:
        command.error(f"{' '.join(unknown)} is too much; name one")
    return command.read(parsed)


def check_empty(parser: CommandParser, words: Sequence[str]) -> None:
    """End the program where an argument is empty, which would stand for the current folder."""
    for before, word in pairwise(["", *words]):
        option = word[:-1] if word.startswith("--") and word.endswith("=") else before
        if not word or option != before:
            name = option if option.startswith("-") else "an input"
            parser.error(f"{name} is empty; is it a variable that is not set?")


def check_command(parser: CommandParser, words: Sequence[str]) -> None:
    """End the program where no command is named, with the nearest one."""
    named = [word for word in words if not word.startswith("-")]
    if not words:
        parser.error(f"name a command: {', '.join(COMMANDS)}")
    command = next((word for word in words if word in COMMANDS), None)
    first = words[0].partition("=")[0]
    if command and first.startswith("-") and first in option_names(command):
        parser.error(f"{first} goes after {command}")
    if not named or named[0] in COMMANDS or first == COMPLETION:
        return
    if named[0] == "help":
        parser.error(f"write {' '.join(['blur2view', *named[1:2], '--help'])}")
    near = get_close_matches(named[0], COMMANDS, 1)
    if near:
        parser.error(f"{named[0]} is no command; did you mean {near[0]}?")
    if os.path.lexists(named[0]):
        parser.error(f"{named[0]} is no command; did you mean blur2view estimate {named[0]}?")
    parser.error(f"{named[0]} is no command; there are {', '.join(COMMANDS)}")


def check_option(parser: CommandParser, word: str, *, known: bool) -> None:
    """End the program where a word is no option of the command; argparse takes -out for -o ut."""
    command, names = parser.command, parser.names
    if len(word) > 2 and (meant := [name for name in sorted(names) if name.startswith(f"-{word}")]):
        parser.error(f"{word} has one dash; did you mean {meant[0]}?")
    if known:
        return
    if why := refusals(options_of(command)).get(word):
        parser.error(f"{word} is not for {command}: {why}")
    if owners := [f"blur2view {other}" for other in COMMANDS if word in option_names(other)]:
        parser.error(f"{word} is an option of {', '.join(owners)}, not of {command}")
    near = [name for name in sorted(names) if len(name) > 3 and word.startswith(name)]
    near += get_close_matches(word, sorted(names), 1, 0.75)
    near += [meant for said, meant in MEANT.items() if word in said.split()]
    remedy = "".join(f"; did you mean {name}?" for name in near[:1])
    parser.error(f"{word} is no option of {command}{remedy}")


def option_names(command: str) -> set[str]:
    """Return the names of a command's options."""
    return CommandParser(command=command).names


def build_parser() -> CommandParser:
    """Return the parser; its defaults are those of the option dataclasses."""
    parser = CommandParser(prog="blur2view", description=DESCRIPTION)
    parser.add_argument(
        COMPLETION,
        metavar="SHELL",
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
