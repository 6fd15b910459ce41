"""The kill loop finds what a kill destroys, and commands that are killed lose nothing."""

import sys
from pathlib import Path

import numpy as np
import pytest

from tools.robustness import corpus
from tools.robustness.killed_calls import try_call

IN_PLACE = """
import time
data = open("project.db", "rb").read()
with open("project.db", "r+b") as file:
    file.truncate(5000)
    file.flush()
    time.sleep(0.5)
    file.write(data)
"""
"""A program that writes a user's file in place, and is safe only if nobody kills it."""


@pytest.mark.parametrize(("program", "safe"), [(IN_PLACE, False), ("import time; time.sleep(0.1)", True)])
def test_a_planted_loss_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, safe: bool
) -> None:
    monkeypatch.setattr(corpus, "PROGRAM", (sys.executable, "-c", program))
    came, wrong = try_call(tmp_path, ["a"], 6, np.random.default_rng(0))
    assert came["killed"] + came["ended before"] == 6
    assert ("project.db is lost" in wrong) == (not safe)
    assert not safe or wrong == []
