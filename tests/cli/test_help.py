"""``blur2view --help``: how fast it is, and that it explains everything."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from blur2view.cli import commands as cli
from blur2view.cli.adapter import CommandParser, group
from blur2view.cli.options import Printing
from blur2view.results.photograph import explanations
from tests.support.calls import call_program

ROOT = Path(__file__).parents[2]
WITHOUT_ESTIMATE = ("place", "recover", "to-transforms")
HEAVY = ["scipy", "skimage", "onnxruntime", "pycolmap"]


@dataclass(frozen=True, kw_only=True)
class CountOptions:
    """The options of ``blur2view count``.

    Count.

    Rarely:
    --floor SHARE: least share that moves
        (default: %(default)s)
    """

    floor: float = 0.5
    printing: Printing = group(Printing)
    examples = ("blur2view count",)

    @staticmethod
    def tables() -> dict[str, str]:
        """Return what --help-all lists besides options."""
        return {"colours": "red: as blood\nblue: as the\n    sea"}


def test_an_option_is_declared_once(capsys: pytest.CaptureFixture[str]) -> None:
    parser = CommandParser("count", CountOptions)
    for words, code, printed in (
        (["--help-all"], 0, "--floor SHARE least share that moves (default: 0.5)"),
        (["--help-all"], 0, "blue as the sea"),
        (["--floor", "x"], 2, "count: --floor: expected a number, got 'x' (see blur2view count --help)"),
    ):
        with pytest.raises(SystemExit) as caught:
            parser.read(words)
        captured = capsys.readouterr()
        assert caught.value.code == code and printed in " ".join((captured.out + captured.err).split())
    assert "--floor" not in parser.format_help()
    options = parser.read(["--floor", "0.25", "-v"])
    assert options == CountOptions(floor=0.25, printing=Printing(verbose=True))
    assert parser.read([]) == CountOptions()


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
    own = () if command in WITHOUT_ESTIMATE else ("input:", "output:", "camera:", "estimation:")
    assert all(f"\n{section}\n" in text for section in (*own, "exit codes:", "examples:"))
    assert f"blur2view {command} " in text[text.index("examples:") :]
    short = call_program(capsys, command, "--help").out
    assert short.startswith(f"usage: blur2view {command} ") and "[OPTIONS]" in short
    assert len(short) < len(text) and "--help-all" in short
    if command in ("estimate", "segment", "triage"):
        words = text.replace(",", " ").split()
        assert [key for key in explanations(flat=command == "triage") if key not in words] == []


def test_overview_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    text = call_program(capsys, "--help").out
    assert all(f"  {command} " in text or f"  {command}\n" in text for command in cli.COMMANDS)
    assert call_program(capsys, "--version").out.startswith("blur2view ")
