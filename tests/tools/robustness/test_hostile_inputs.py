"""The judge of calls finds what is wrong with one, and hostile inputs are the same every time."""

import json
import shutil
import signal
import sqlite3
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view.cli import commands
from blur2view.photographs.image import read_image
from tools.database_safety.colmap_projects import ProjectOptions, make_project
from tools.robustness import hostile_inputs
from tools.robustness.hostile_cases import COMMANDS, SHARES, Case, make_cases
from tools.robustness.hostile_databases import DATABASE, changes, put_database, snapshot
from tools.robustness.hostile_files import CONTENTS, encoded, hostile_photograph
from tools.robustness.hostile_inputs import Tried, run_call, try_all
from tools.robustness.hostile_models import OF_MODELS, put_model
from tools.robustness.hostile_results import spoil
from tools.robustness.politeness import Call, complaints


@pytest.fixture
def call(tmp_path: Path) -> Call:
    """Return a call of ``estimate --json`` with nothing wrong: one photograph done, one refused."""
    document = {"estimates": [{"image": "good.jpg"}], "failures": [{"image": "bad.jpg", "error": "damaged"}]}
    return Call(
        words=["estimate", "--json"],
        folder=tmp_path,
        photographs=[tmp_path / "good.jpg", tmp_path / "bad.jpg"],
        code=1,
        printed=json.dumps(document).encode() + b"\n",
        said=b"blur2view: bad.jpg: is damaged; copy it again\n",
        seconds=1.0,
        peak_gib=0.3,
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"code": None}, "hangs"),
        ({"code": -11}, "exit code -11"),
        ({"peak_gib": 2.5}, "takes 2.50 GiB"),
        ({"seconds": 33.0}, "takes 33 s of a processor"),
        ({"said": b"Traceback (most recent call last):\n  x\nValueError: 3\n"}, "traceback: ValueError: 3"),
        ({"said": b"libpng warning: iCCP\nblur2view: bad.jpg: x; y\n"}, "foreign line: libpng"),
        ({"said": b"blur2view: \x1b[31m.jpg: x; y\n"}, "control characters"),
        ({"said": b"blur2view: bad.jpg: x; y"}, "is not whole"),
        ({"said": b"", "code": 1}, "exit code 1 with 0 lines"),
        ({"said": b"blur2view: a\n" * 3}, "3 lines about 2 photographs"),
        ({"said": b"blur2view: a; b\n", "code": 2}, "its usage error is none"),
    ],
)
def test_what_is_wrong_is_found(call: Call, change: dict[str, object], words: str) -> None:
    assert any(words in complaint for complaint in complaints(replace(call, **change)))  # type: ignore[arg-type]


def test_a_polite_call_has_no_complaints_and_a_photograph_left_undone_is_found(call: Call) -> None:
    assert complaints(call) == []
    document = {"estimates": [], "failures": [{"image": "bad.jpg", "error": "damaged"}]}
    undone = replace(call, printed=json.dumps(document).encode())
    assert complaints(undone) == ["0 photographs done, 1 expected"]
    assert complaints(undone, full_disk=True) == []


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        (".a.json.12.tmp", b"", "leaves .a.json.12.tmp"),
        ("a.json", b"{", "a.json is damaged"),
        ("a.png", b"\x89PNG", "a.png is cut"),
        ("page.html", b"<html>", "page.html is cut"),
        ("a.smear.npz", b"PK", "a.smear.npz is damaged"),
        ("new.db", b"SQLite format 3", "new.db is damaged"),
        ("b.json", b"{}", "leaves b without .png, .smear.npz"),
    ],
)
def test_files_that_are_not_whole_are_found(call: Call, name: str, content: bytes, words: str) -> None:
    (call.folder / name).write_bytes(content)
    assert any(words in complaint for complaint in complaints(call))


def drawn(folder: Path, seed: int) -> list[Any]:
    """Return what is drawn of a seed: named inputs, arguments, photographs, projects and models."""
    folder.mkdir()
    cases = make_cases(folder, 60, seed)
    assert {case.kind for case in cases} == {*SHARES, "arguments"}
    named = sorted([w.replace(str(folder), "") for w in case.named] for case in cases)
    arguments = sorted(case.words for case in cases if case.kind == "arguments")
    photographs, projects, models = [], [], []
    for number in range(len(CONTENTS)):
        path = hostile_photograph(folder, np.random.default_rng([seed, number]), 1000 + number)
        photographs.append(path.read_bytes() if path.is_file() else path.name)
    for number in range(6):
        here = folder / f"call{number}"
        here.mkdir()
        put_database(here, (), seed=(seed, number))
        files, rows = snapshot(here)
        projects.append((sorted(files), rows))
        shutil.rmtree(here)
        here.mkdir()
        put_model(here, OF_MODELS[number % 3], seed=(seed, number))
        models.append([path.read_bytes() for path in sorted((here / "model").iterdir()) if path.is_file()])
    return [named, arguments, photographs, projects, models]


@pytest.mark.slow
def test_equal_seeds_give_equal_inputs_of_every_kind(tmp_path: Path) -> None:
    parts = [drawn(tmp_path / name, seed) for name, seed in zip("abc", (3, 3, 4), strict=True)]
    for one, two, other in zip(*parts, strict=True):
        assert one == two != other
    assert {words[0] for words in (*COMMANDS, *OF_MODELS)} == set(commands.COMMANDS)
    (tmp_path / "a.png").write_bytes(encoded(np.random.default_rng(0), "PNG"))
    assert read_image(tmp_path / "a.png").shape[2] == 3  # a picture before any damage


def test_changes_of_a_database_are_found(call: Call) -> None:
    link = replace(call, words=["to-colmap", "--link", "--db", DATABASE])
    make_project(call.folder / DATABASE, ProjectOptions(wal=False))
    before = snapshot(call.folder)
    assert not list(changes(link, before)) and not list(changes(replace(link, code=0), before))
    with closing(sqlite3.connect(call.folder / DATABASE)) as database:
        database.execute("DELETE FROM keypoints WHERE image_id = 3")
        database.commit()
    assert list(changes(link, before)) == [f"exit code 1, but {DATABASE} changed"]
    assert list(changes(replace(link, code=0), before)) == ["rows of the user's changed"]
    assert list(changes(replace(call, code=0), before)) == [f"exit code 0, but {DATABASE} changed"]


def test_spoiled_results_are_other_ones(tmp_path: Path) -> None:
    (tmp_path / "a.manifest.jsonl").write_text('{"blur2view": "1"}\n{"image": "a", "outputs": {"b": "c"}}\n')
    content = (tmp_path / "a.manifest.jsonl").read_bytes()
    for seed in range(30):
        (tmp_path / f"{seed}").mkdir()
        path = tmp_path / f"{seed}" / "a.manifest.jsonl"
        path.write_bytes(content)
        spoil(path.parent, np.random.default_rng(seed))
        assert not path.is_file() or path.stat().st_size == 0 or path.read_bytes() != content


def test_a_row_with_an_error_is_no_photograph_done(call: Call) -> None:
    triage = replace(call, words=["triage", "--csv", "table.csv"])
    (call.folder / "table.csv").write_text("name,error\ngood.jpg,\nbad.jpg,damaged\n")
    assert complaints(triage) == []
    (call.folder / "table.csv").write_bytes(b"name,error\n\xff.jpg,\nbad.jpg,damaged\n")
    assert complaints(triage) == []
    (call.folder / "table.csv").unlink()
    assert "its results cannot be counted" in complaints(triage)[0]
    (call.folder / "table.csv").write_text("name,error\nbad.jpg,damaged\n")
    assert complaints(triage) == ["0 photographs done, 1 expected"]


def test_of_inputs_that_nobody_counts_the_good_one_must_be_done(call: Call) -> None:
    lines = b"blur2view: a.jpg: is damaged; x\n" * 5
    document = {"estimates": [{"image": "good.jpg"}], "failures": [{"image": "x", "error": "y"}] * 5}
    printed = json.dumps(document).encode()
    many = replace(call, counted=False, said=lines, printed=printed, photographs=call.photographs[:1])
    assert complaints(many) == []
    none = json.dumps(document | {"estimates": []}).encode()
    assert complaints(replace(many, printed=none)) == ["0 photographs done, -4 expected"]
    unread = replace(many, said=b"blur2view: x: the list cannot be read (y); z\n", printed=b"")
    assert complaints(unread) == []


def test_a_log_goes_on_and_tries_rude_cases_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rude_one: set[int] = {3}
    tried: list[int] = []

    def through(place: Path, number: int, case: Case) -> Tried:
        tried.append(number)
        rude = ["hangs"] if number in rude_one else []
        return Tried(
            number=number, kind=case.kind, inputs=1, codes=[1], longest_s=1.0, most_gib=0.1, rude=rude
        )

    monkeypatch.setattr(hostile_inputs, "_load_libraries", lambda: None)
    monkeypatch.setattr(hostile_inputs, "_call_earlier", lambda place: None)
    monkeypatch.setattr(hostile_inputs, "_through_all_commands", through)
    log = tmp_path / "log.jsonl"
    first = try_all(20, 5, lambda line: None, log=log)
    assert [one.number for one in first if one.rude] == [3]
    lines = log.read_text().splitlines()
    log.write_text("\n".join(lines[:7]) + '\n{"number": 3, "ki')  # stopped in the seventh case
    tried.clear()
    rude_one.clear()
    second = try_all(20, 5, lambda line: None, log=log)
    assert tried == [3, *range(6, len(first))]
    assert [one.number for one in second] == list(range(len(first)))
    with pytest.raises(SystemExit, match="was begun with"):
        try_all(20, 6, lambda line: None, log=log)


def test_the_table_counts_what_was_mended() -> None:
    one = Tried(
        number=0, kind="disks", inputs=8, codes=[0, 1, None], longest_s=2.0, most_gib=0.5, rude=["hangs"]
    )
    other = replace(one, number=1, kind="lists", inputs=1, codes=[2], rude=[], mended=2)
    lines = hostile_inputs.page([one, other], 20, 5).splitlines()
    assert lines[0].startswith("Seed 5, 9 of 20 inputs. ")
    assert lines[-3:] == [
        "| disks | 8 | 3 | 1, 1, 0 | 2.0 | 0.50 | 0 | 1 |",
        "| lists | 1 | 1 | 0, 0, 1 | 2.0 | 0.50 | 2 | 0 |",
        "| all | 9 | 4 | 1, 1, 1 | 2.0 | 0.50 | 2 | 1 |",
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("sleeps", "code"), [(True, None), (False, -signal.SIGXCPU)])
def test_who_waits_or_works_for_ever_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sleeps: bool, code: int | None
) -> None:
    monkeypatch.setattr(hostile_inputs, "PATIENCE_S", 0.3 if sleeps else 300.0)
    monkeypatch.setattr(hostile_inputs, "MOST_S", 0)

    def program() -> int:
        while True:
            if sleeps:
                time.sleep(0.2)

    monkeypatch.setattr("blur2view.__main__.program", program)
    call = run_call([], tmp_path, Case(kind="x"), fresh=False)
    assert call.code == code
    assert call.seconds > 0.9 or sleeps


@pytest.mark.slow
def test_commands_are_polite() -> None:
    tries = try_all(12, 5, say=lambda line: None)
    assert [complaint for tried in tries for complaint in tried.rude] == []
    assert sum(tried.inputs for tried in tries) == 12
