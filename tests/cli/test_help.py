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

    THING: what to count
    Rarely:
    --floor SHARE: least share that moves
        (default: %(default)s)
    """

    things: list[str]
    floor: float = 0.5
    printing: Printing = group(Printing)
    examples = ("blur2view count",)

    @staticmethod
    def tables() -> dict[str, str]:
        """Return what --help-all lists besides options."""
        return {"colours": "red: as blood\nblue: as the\n    sea"}


def test_an_option_is_declared_once(capsys: pytest.CaptureFixture[str]) -> None:
    short, whole = (CommandParser("count", CountOptions, everything=one) for one in (False, True))
    text = " ".join(whole.format_help().split())
    assert "--floor SHARE least share that moves (default: 0.5)" in text and "blue as the sea" in text
    assert "--floor" not in short.format_help() and "count [OPTIONS] THING..." in text
    with pytest.raises(SystemExit, match="2"):
        short.read(["a", "--floor", "x"])
    complaint = "blur2view count: --floor: expected a number, got 'x' (see blur2view count --help)\n"
    assert capsys.readouterr().err == complaint
    options = short.read(["a", "--floor", "0.25", "-v", "b", "--", "-c"])
    assert options == CountOptions(things=["a", "b", "-c"], floor=0.25, printing=Printing(verbose=True))
    assert short.read(["a"]) == CountOptions(things=["a"])


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
    sections = (*own, "options:", "exit codes:", "examples:")
    assert all(text.count(f"\n{section}\n") == 1 for section in sections)
    assert f"blur2view {command} " in text[text.index("examples:") :]
    assert own or not {"--json", "--resume"} & set(text.split())
    short = call_program(capsys, command, "--help").out
    assert short.startswith(f"usage: blur2view {command} [OPTIONS] ")
    assert len(short) < len(text) and "--help-all" in short
    if command in ("estimate", "segment", "triage"):
        words = text.replace(",", " ").split()
        assert [key for key in explanations(flat=command == "triage") if key not in words] == []


def test_overview_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    text = call_program(capsys, "--help").out
    assert all(f"  {command} " in text or f"  {command}\n" in text for command in cli.COMMANDS)
    assert call_program(capsys, "--version").out.startswith("blur2view ")
