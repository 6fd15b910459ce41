"""The fuzz test finds planted faults, draws the same cases again, and eight calls are not rude."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tools.evaluation import fuzz

pytestmark = pytest.mark.slow
CASES, SEED = 4, 61


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a place for cases, with inputs of every kind."""
    path = tmp_path_factory.mktemp("fuzz")
    fuzz.make_place(path)
    return path


@pytest.mark.parametrize(
    ("program", "complaint"),
    [
        ("open('good.jpg', 'ab').write(b'x')", "changes or removes good.jpg"),
        ("open('../x', 'w')", "leaves x outside"),
        ("import sys; sys.stderr.write('fine')", "foreign line fine"),
        ("import os; os.abort()", "exit code -6"),
        ("raise SystemExit(1)", "fails in silence"),
        ("import subprocess; subprocess.run(['convert'])", "leaves ran outside"),
        ("import socket; socket.socket().connect_ex(('127.0.0.1', 9))", "opens a socket"),
        ("import time; time.sleep(99)", "exit code -9"),
    ],
)
def test_a_planted_fault_is_found(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, complaint: str
) -> None:
    if "socket" in program and shutil.which("strace") is None:
        pytest.skip("needs strace")
    (tmp_path / "whole").symlink_to(place / "whole")
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/convert").symlink_to(place / "bin/convert")
    (tmp_path / "bin/program").write_text(program)
    (tmp_path / "case").mkdir()
    (tmp_path / "case/good.jpg").write_bytes(b"photograph")
    before = fuzz.snapshot(tmp_path / "case")
    done = fuzz.call(tmp_path / "case", ["estimate", "good.jpg"], 0, 2.0 if "sleep" in program else 60.0)
    (place / "ran").exists() and (place / "ran").rename(tmp_path / "ran")
    assert any(complaint in found for found in fuzz.complaints(tmp_path / "case", before, done))


def test_a_mutation_is_drawn_from_its_seed() -> None:
    data = b'{"image": "a.jpg", "rows": [1, 2.5]}' * 9
    drawn = [fuzz.mutated(data, np.random.default_rng(seed)) for seed in range(50)]
    assert drawn == [fuzz.mutated(data, np.random.default_rng(seed)) for seed in range(50)]
    assert len(set(drawn)) > 40


@pytest.mark.parametrize("first", range(0, 2 * CASES, CASES))
def test_no_call_is_rude(place: Path, first: int) -> None:
    assert not [
        found for case in range(first, first + CASES) for found in fuzz.try_case(place, SEED, case)[2]
    ]
