"""``blur2view --help``: how fast it is, and that it explains everything."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from blur2view.cli import commands as cli
from blur2view.cli.estimate import EstimateOptions
from blur2view.cli.options import Estimating, Printing, Reading
from blur2view.cli.start import NETWORK_COMMANDS
from blur2view.records.record import LOOK, explanations
from tests.support.calls import call_program

ROOT = Path(__file__).parents[2]
WITHOUT_ESTIMATE = ("place", "reconstruct", "recover", "to-transforms")
HEAVY = ["argcomplete", "scipy", "skimage", "onnxruntime", "pycolmap"]


def test_options_are_read_on_both_sides_of_photographs_and_wrong_ones_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    parser = cli.command_parser("estimate")
    options = parser.read(["a", "--seed", "7", "-v", "b", "--", "-c", "-o.jpg"])
    reading, estimating = Reading(images=["a", "b", "./-c", "./-o.jpg"]), Estimating(seed=7)
    printing = Printing(verbose=True)
    assert options == EstimateOptions(reading=reading, estimating=estimating, printing=printing)
    with pytest.raises(SystemExit, match="2"):
        parser.read(["a", "--beta", "x"])
    complaint = "blur2view estimate: --beta: expected a number, got 'x' (see blur2view estimate --help)\n"
    assert capsys.readouterr().err == complaint
    assert "--seed" not in parser.format_help() and "estimate [OPTIONS] INPUT..." in parser.format_help()


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
    if command == "triage":  # which names the columns of all tables, in their order
        named = re.findall(
            r"(?m)^  ([A-Za-z]\w+)  ", text[text.index("columns of --csv:") : text.index("what is")]
        )
        assert named == list(explanations(flat=True)) and tuple(named[: len(LOOK)]) == LOOK
    if command in ("estimate", "segment", "triage"):
        words = text.replace(",", " ").split()
        assert [key for key in explanations(flat=command == "triage") if key not in words] == []


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_short_help_names_only_options_that_it_lists_in_one_piece_with_their_defaults(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "61")
    whole, text = (call_program(capsys, command, word).out for word in ("--help-all", "--help"))
    options = set(cli.command_parser(command)._option_string_actions)
    named = set(re.findall(r"(?<![\w-])--?[a-z][\w-]*", whole.partition("examples:")[0]))
    assert {name for name in named if name.endswith("-")} == set()
    text = text.partition("examples:")[0]
    others = {"--no-sequence", "--image_path", "--link"}  # of COLMAP, and of to-colmap
    listed = set(re.findall(r"(?m)^  (?:-\w[^-]*)?(?:-\w, )?(--[\w-]+)", text)) | {"-o", "-v", "-q", "-h"}
    assert set(re.findall(r"(?<![\w-])--[a-z][\w-]*", text)) - others <= listed <= options | {"-o"}
    assert "see below" not in text and "see --help-all" not in text
    if command == "triage":
        assert "(default: 3)" in text


def test_each_command_has_its_own_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    codes = {}
    for command in cli.COMMANDS:
        text = call_program(capsys, command, "--help-all").out
        codes[command] = text.partition("exit codes:")[2].partition("\n\n")[0]
    assert "photograph without F" in codes["estimate"] and "photograph without F" not in codes["triage"]
    assert "photograph" not in codes["place"]


def test_overview_names_every_command_and_comes_without_a_word(capsys: pytest.CaptureFixture[str]) -> None:
    text = call_program(capsys, "--help").out
    assert (bare := call_program(capsys)) == 0 and bare.out == text
    assert all(f"  {command} " in text or f"  {command}\n" in text for command in cli.COMMANDS)
    assert call_program(capsys, "--version").out.startswith("blur2view ")


def test_the_network_is_opened_early_for_every_command_that_reads_photographs() -> None:
    assert cli.COMMANDS.keys() - {"place", "to-transforms"} == NETWORK_COMMANDS
