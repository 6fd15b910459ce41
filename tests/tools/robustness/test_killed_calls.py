"""The kill loop finds what a kill destroys, and commands that are killed lose nothing."""

import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from tools.robustness import corpus
from tools.robustness.corpus import make_project
from tools.robustness.killed_calls import left, lost, try_call

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


def test_what_is_lost_is_found(tmp_path: Path) -> None:
    make_project(tmp_path, 0)
    before = left(tmp_path)
    assert lost(tmp_path, before, before) == []
    with closing(sqlite3.connect(tmp_path / "project.db")) as database:
        database.execute("DELETE FROM keypoints WHERE image_id = 3")
        database.commit()
    assert lost(tmp_path, before, before) == ["project.db is lost"]
    assert lost(tmp_path, before, left(tmp_path)) == []  # as an undisturbed call leaves it
    (tmp_path / "a.json").write_text('{"half": ')
    assert "a.json is damaged" in lost(tmp_path, before, left(tmp_path))[0]


@pytest.mark.parametrize(("program", "safe"), [(IN_PLACE, False), ("import time; time.sleep(0.1)", True)])
def test_a_planted_loss_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, safe: bool
) -> None:
    monkeypatch.setattr(corpus, "PROGRAM", (sys.executable, "-c", program))
    came, wrong = try_call(tmp_path, ["a"], 6, np.random.default_rng(0))
    assert came["killed"] + came["ended before"] == 6
    assert ("project.db is lost" in wrong) == (not safe)
    assert not safe or wrong == []
