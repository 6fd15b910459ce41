"""Fixtures of the command line: a folder of three kinds of photographs, and commands with a tiny network."""

from pathlib import Path

import numpy as np
import pytest

from blur2view.cli import commands as cli
from tests.support.colour_code import colour_code, forward_motion, write_picture
from tests.support.tables import Call


@pytest.fixture
def call(tiny_model: Path) -> Call:
    """Return a function that runs a command in this process."""

    def run(command: str, *words: object) -> int:
        return cli.main([command, "--model", str(tiny_model), "--jobs", "1", *map(str, words)])

    return run


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """Return a folder of photographs: one still, one blurred by forward motion, one without any order."""
    folder = tmp_path / "frames"
    (folder / "left").mkdir(parents=True)
    texture = 1 + 0.5 * (np.indices((64, 80)) // 8 % 2).sum(axis=0)  # in sigma; what has none has no smear
    write_picture(folder / "still.png", colour_code(np.zeros((64, 80, 2)), texture))
    write_picture(folder / "left" / "moving.png", colour_code(forward_motion(), 1.0))
    rng = np.random.default_rng(0)
    cells = rng.normal(0, 12, (15, 20, 2))
    chaos = np.repeat(np.repeat(cells, 32, 0), 32, 1)
    write_picture(folder / "chaos.png", colour_code(chaos, 1.0))
    return folder
