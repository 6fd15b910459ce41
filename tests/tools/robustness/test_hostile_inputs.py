"""The judge of calls finds what is wrong with one, and hostile inputs are the same every time."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tools.robustness import corpus, hostile_inputs
from tools.robustness.hostile_inputs import KINDS, run_call, try_all
from tools.robustness.mutations import SHARES, mutated
from tools.robustness.politeness import Call, complaints


@pytest.fixture
def call(tmp_path: Path) -> Call:
    """Return a call of ``estimate`` with nothing wrong: one photograph done, one refused."""
    (tmp_path / "table.csv").write_text("name,error\ngood.jpg,\nbad.jpg,damaged\n")
    (tmp_path / "out").mkdir()
    (tmp_path / "out/good.json").write_text("{}")
    (tmp_path / "out/good.png").write_bytes(b"IEND\xaeB`\x82")
    np.savez(tmp_path / "out/good.smear.npz", ends=np.zeros(4))
    return Call(
        words=["estimate", "-o", "out", "--csv", "table.csv"],
        folder=tmp_path,
        before={},
        photographs=2,
        code=1,
        printed=b"{}",
        said=b"blur2view: bad.jpg: is damaged; copy it again\n",
        seconds=1.0,
        peak_gib=0.3,
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"code": -9}, "exit code -9"),
        ({"said": b"Traceback (most recent call last):\n  x\nValueError: 3\n"}, "ValueError: 3"),
        ({"said": b""}, "exit code 1 with 0 lines"),
        ({"lost": 3}, "3 rows of the user's are gone"),
    ],
)
def test_what_is_wrong_is_found(call: Call, change: dict[str, object], words: str) -> None:
    assert complaints(call) == []
    assert any(words in complaint for complaint in complaints(replace(call, **change)))  # type: ignore[arg-type]


def test_a_mutation_is_drawn_from_its_seed() -> None:
    data = b'{"image": "a.jpg", "rows": [1, 2.5]}' * 9
    for seed in range(50):
        one, two = (mutated(data, np.random.default_rng(seed)) for _ in range(2))
        assert one == two and mutated(b"", np.random.default_rng(seed)) is not None
    assert len({mutated(data, np.random.default_rng(seed)) for seed in range(50)}) > 45
    assert sum(SHARES) == pytest.approx(sum(kind.share for kind in KINDS.values())) == 1


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("open('good.jpg', 'ab').write(b'x')", "changes good.jpg"),
        ("print('fine', file=__import__('sys').stderr)", "foreign line: fine"),
        ("import time; time.sleep(99)", "exit code -9"),
    ],
)
def test_a_planted_fault_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, words: str
) -> None:
    (tmp_path / "good.jpg").write_bytes(b"photograph")
    monkeypatch.setattr(corpus, "PROGRAM", (sys.executable, "-c", program))
    monkeypatch.setattr(hostile_inputs, "MOST_S", 0)
    monkeypatch.setattr(hostile_inputs, "PATIENCE_S", 0.5 if "sleep" in program else 100.0)
    assert any(words in complaint for complaint in complaints(run_call(["estimate", "good.jpg"], tmp_path)))


@pytest.mark.slow
def test_commands_are_polite() -> None:
    assert [rude for _, _, rude in try_all(range(4), 5)] == [[]] * 4
