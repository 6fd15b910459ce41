"""Fixtures of the command line.

A folder of three kinds of photographs; five small photographs, and which of them are read.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view.cli.batch import photograph
from blur2view.images.image import read_picture
from tests.support.colour_code import colour_code, forward_motion, write_picture
from tests.support.many_photographs import write_photographs


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """Return a folder of photographs: one still, one blurred by forward motion, one without any order."""
    folder = tmp_path / "frames"
    (folder / "left").mkdir(parents=True)
    texture = 1 + 0.5 * (np.indices((64, 80)) // 8 % 2).sum(axis=0)  # in sigma; what has none has no smear
    write_picture(folder / "still.png", colour_code(np.zeros((64, 80, 2)), texture))
    write_picture(folder / "left" / "moving.png", colour_code(forward_motion(), 1.0))
    rng = np.random.default_rng(0)
    cells = rng.normal(0, 16, (12, 16, 2))  # four in each window of triage
    chaos = np.repeat(np.repeat(cells, 48, 0), 48, 1)
    write_picture(folder / "chaos.png", colour_code(chaos, 1.0))
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of five small photographs."""
    return write_photographs(tmp_path / "in", 5)[0].parent


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the names of the photographs that are read from now on."""
    names: list[str] = []

    def noted(path: Path, **options: Any) -> Any:
        names.append(Path(path).name)
        return read_picture(path, **options)

    monkeypatch.setattr(photograph, "read_picture", noted)
    return names
