"""Completion in a shell: what argcomplete is told about a line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest


def asked(line: str, file: Path) -> subprocess.CompletedProcess[str]:
    """Run the program as a shell does that asks how a line may go on."""
    shell = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n", "_ARGCOMPLETE_STDOUT_FILENAME": str(file)}
    shell |= {"COMP_LINE": line, "COMP_POINT": str(len(line))} if line else {}
    command = [sys.executable, "-m", "blur2view", "estimate", "x.jpg"]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | shell, check=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("blur2view re", ["recover", "reconstruct", "report"]),
        ("blur2view segment --mas", ["--masks"]),
        ("blur2view segment --masks n", ["nerfstudio"]),
        ("blur2view estimate --read", ["--readout"]),  # which --help-all alone shows
    ],
)
def test_commands_options_and_names_are_completed(line: str, words: list[str], tmp_path: Path) -> None:
    done = asked(line, tmp_path / "answer")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert [word.strip() for word in (tmp_path / "answer").read_text().split("\n")] == words


@pytest.mark.slow
def test_no_command_runs_where_a_shell_asks_nothing(tmp_path: Path) -> None:
    done = asked("", tmp_path / "answer")
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "")
