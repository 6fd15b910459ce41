"""Commands in this process: their exit codes, with what they printed."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from blur2view.cli import commands


class Exit(int):
    """An exit code, with what the command printed."""

    out = err = ""

    @property
    def lines(self) -> list[str]:
        """The lines on stderr."""
        return self.err.splitlines()

    @property
    def line(self) -> str:
        """The only line on stderr."""
        (only,) = self.lines
        return only

    @property
    def document(self) -> Any:
        """The JSON document on stdout."""
        return json.loads(self.out)


Call = Callable[..., Exit]
"""Runs a command with the tiny network, given its name and words."""


def call_program(capsys: pytest.CaptureFixture[str], *words: object) -> Exit:
    """Run the program in this process."""
    capsys.readouterr()
    try:
        code = commands.main([str(word) for word in words])
    except SystemExit as usage:
        code = int(usage.code or 0)
    done, printed = Exit(code), capsys.readouterr()
    done.out, done.err = printed
    return done


READ = {"name", "use", "blur", "verdict", "error"}  # columns that scripts read


def table(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table."""
    with path.open(newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    assert set(reader.fieldnames or ()) >= READ
    return rows
