"""What a stranger names by mistake, and from another folder: one line each that names the remedy."""

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from blur2view.runs.job import file_digest
from tests.support.calls import Call
from tests.support.many_photographs import contents, write_photographs
from tests.support.tables import table


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of three small photographs."""
    return write_photographs(tmp_path / "in", 3)[0].parent


def test_database_that_is_the_current_folder_is_one_line(
    call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    done = call("to-colmap", "--db", ".", "000.png", "001.png")
    assert done == 1 and "exists" in done.line and not list(folder.parent.glob(".*.jsonl"))


@pytest.mark.skipif(not Path("/proc/self/comm").exists(), reason="Linux alone has such files")
def test_file_that_says_it_is_empty_is_not_read(call: Call, tmp_path: Path) -> None:
    odd = Path("/proc/self/comm")  # /proc/kmsg, another one, would wait for ever
    assert odd.stat().st_size == 0 and odd.read_bytes()
    assert file_digest(odd) == hashlib.sha256(b"").hexdigest()
    done = call("estimate", odd)
    assert done == 1 and "is no regular file" in done.line


def test_list_without_its_mark_is_told(call: Call, folder: Path) -> None:
    (folder / "list.txt").write_text("000.png\n001.png\n")
    done = call("estimate", folder / "list.txt")
    assert done == 1 and done.line.endswith(f"if it lists photographs, write @{folder / 'list.txt'}")
    (folder / "bytes.bin").write_bytes(b"\xff\0\xfe")
    assert "write @" not in call("estimate", folder / "bytes.bin").line


@pytest.mark.parametrize(
    "command", ["triage --keep keep.txt", "estimate -o out", "report --no-mask -o a.html"]
)
def test_folder_without_photographs_is_one_line_and_no_photograph(
    call: Call, folder: Path, here: Path, command: str
) -> None:
    (here / "empty").mkdir()
    name, *words = command.split()
    done = call(name, "empty", *words, "--csv", "new/t.csv")
    assert (done, done.out) == (1, "") and "empty: holds no photograph" in done.line
    assert {path.name for path in here.iterdir()} == {"in", "empty"}
    done = call(name, folder, "empty", *words, "--csv", "t.csv")
    assert done == 1 and "empty: holds no photograph" in done.line
    assert [row["name"] for row in table(here / "t.csv")] == ["000.png", "001.png", "002.png"]
    if name == "report":
        assert (here / "a.html").read_text().count('<li class="card') == 3


def test_photograph_of_the_same_name_in_another_folder_replaces_no_results(
    call: Call, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "other"
    shutil.copytree(folder, other)
    for name in ("000.png", "001.png"):
        shutil.copy(folder / "002.png", other / name)
    monkeypatch.chdir(folder)
    assert call("estimate", "000.png", "001.png", "-o", tmp_path / "out") == 0
    before = contents(tmp_path / "out")
    monkeypatch.chdir(other)
    done = call("estimate", "000.png", "001.png", "-o", tmp_path / "out", "--resume")
    assert done == 1 and contents(tmp_path / "out") == before and len(done.lines) == 2
    assert "000.png: its results would replace those of ../in/000.png" in done.lines[0]
    words = ("000.png", "001.png", "-o", tmp_path / "out", "--resume", "--overwrite")
    assert call("estimate", *words) == 0 and contents(tmp_path / "out") != before


def test_results_that_were_moved_are_gone_on_with(call: Call, folder: Path, tmp_path: Path) -> None:
    assert call("estimate", folder, "-o", tmp_path / "out") == 0
    (tmp_path / "deep").mkdir()
    (tmp_path / "out").rename(tmp_path / "deep/out")
    assert call("estimate", folder, "-o", tmp_path / "deep/out", "--resume") == 0


@pytest.mark.parametrize("words", ["estimate -o out", "segment -o out", "triage --csv t.csv"])
def test_manifests_of_equal_calls_without_timings_are_equal(
    call: Call, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    found = []
    for place in ("first", "second"):
        shutil.copytree(folder, tmp_path / place / "in")
        monkeypatch.chdir(tmp_path / place)
        assert call(*words.split(), "in", "--no-timings") == 0
        (manifest,) = Path().rglob("*.manifest.jsonl")
        found.append(manifest.read_bytes())
    assert found[0] == found[1] and len(found[0].splitlines()) >= 4
    assert not any("seconds" in json.loads(line) for line in found[0].splitlines())
