"""``blur2view --help``: how fast it is, and that it explains everything."""

import dataclasses
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from blur2view.cli import commands as cli
from blur2view.cli.arguments.option import option
from blur2view.cli.arguments.parser import CommandParser
from blur2view.cli.segment import SegmentOptions
from blur2view.results import estimate, masks, to_colmap
from tests.support.calls import call_program

ROOT = Path(__file__).parents[2]
WITHOUT_ESTIMATE = ("place", "to-transforms")
HEAVY = ["scipy", "skimage", "onnxruntime", "pycolmap", "tqdm"]
REFERENCE = {
    "estimate": estimate.EstimateDocument,
    "segment": masks.MaskDocument,
    "to-colmap": to_colmap.ViewsDocument,
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class MoreOptions(SegmentOptions):
    """Those of segment, and one more.

    Segment.
    """

    floor: float = option(0.5, "SHARE", rare=True)
    "least share of the picture that moves (default: %(default)s)"


def test_a_synopsis_names_what_is_needed_and_that_there_are_options(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for words, printed in (
        ("place --help", "usage: blur2view place -o DIR [OPTIONS] DB MODEL FRAMES"),
        ("estimate --help", "usage: blur2view estimate [OPTIONS] INPUT [INPUT ...]"),
        ("--help-all", "commands:"),
    ):
        with pytest.raises(SystemExit) as caught:
            cli.main(words.split())
        assert caught.value.code == 0 and printed in capsys.readouterr().out


def test_an_option_is_declared_once(capsys: pytest.CaptureFixture[str]) -> None:
    parser = CommandParser(prog="segment").of(MoreOptions)
    for words, code, printed in (
        (["--help-all"], 0, "--floor SHARE least share of the picture that moves (default: 0.5)"),
        (["a.png", "--floor", "x"], 2, "segment: --floor: expected a number, got 'x' (see segment --help)"),
    ):
        with pytest.raises(SystemExit) as caught:
            parser.parse_args(words)
        captured = capsys.readouterr()
        assert caught.value.code == code and printed in " ".join((captured.out + captured.err).split())
    assert "--floor" not in parser.format_help()
    options: Any = parser.read(parser.parse_args(["a.png", "--floor", "0.25"]))
    assert options.floor == 0.25 and options.masks is None


def test_help_imports_no_network_and_no_colmap() -> None:
    program = f"""
import sys
from contextlib import suppress
from blur2view.cli.commands import main
for command in {list(cli.COMMANDS)}:
    with suppress(SystemExit):
        main([command, "--help"])
print([name for name in {HEAVY} if name in sys.modules])
"""
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_help_has_groups_exit_codes_and_examples(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = call_program(capsys, command, "--help-all").out
    own = () if command in WITHOUT_ESTIMATE else ("camera:", "estimation:")
    sections = ("input:", "output:", *own, "exit codes:", "examples:")
    places = [text.index(f"\n{section}\n") for section in sections]
    assert places == sorted(places) and f"blur2view {command} " in text[places[-1] :]
    if command in REFERENCE:
        words = text.replace(",", " ").split()
        assert [f.name for f in dataclasses.fields(REFERENCE[command]) if f.name not in words] == []


def test_a_shell_completes_commands_options_and_choices(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("shtab")
    printed = call_program(capsys, "--completion", "bash").out
    done = subprocess.run(["bash", "-n"], input=printed, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert all(
        word in printed for word in ("to-transforms", "--max-smear", "nerfstudio", "_shtab_compgen_files")
    )
