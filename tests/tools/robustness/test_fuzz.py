"""The fuzz test finds planted faults, and two calls are not rude."""

import subprocess
from pathlib import Path

import pytest

from tools.robustness import fuzz
from tools.robustness.odd_inputs import make_inputs


@pytest.mark.parametrize(
    ("text", "code", "complaint"),
    [
        ("", -6, "exit code -6"),
        ("", 1, "fails in silence"),
        ("fine", 0, "foreign line fine"),
        ("blur2view: \x1b[31m", 1, "prints '\\x1b'"),
        ("blur2view: Traceback", 1, "traceback"),
    ],
)
def test_a_rude_answer_is_found(tmp_path: Path, text: str, code: int, complaint: str) -> None:
    (tmp_path / "case").mkdir()
    done = subprocess.CompletedProcess([], code, "", text)
    found = fuzz.complaints(tmp_path / "case", {}, ["estimate"], done)
    assert [one for one in found if complaint in one]


def test_what_is_changed_and_what_is_left_is_found(tmp_path: Path) -> None:
    folder, done = tmp_path / "case", subprocess.CompletedProcess[str]([], 0, "", "")
    folder.mkdir()
    (folder / "good.jpg").write_bytes(b"photograph")
    before = fuzz.snapshot(folder)
    assert fuzz.complaints(folder, before, ["estimate", "-o", "out"], done) == []
    for path in (folder / "good.jpg", folder / "out", folder / "stray", tmp_path / "x"):
        path.write_text("x")
    found = set(fuzz.complaints(folder, before, ["estimate", "-o", "out"], done))
    assert found == {"changes or removes good.jpg", "leaves stray", "leaves x outside"}


@pytest.mark.slow
def test_no_call_is_rude(tmp_path: Path) -> None:
    make_inputs(tmp_path / "whole")
    assert not [found for number in range(2) for found in fuzz.try_case(tmp_path, 61, number)[1]]
