"""What a stranger names by mistake, and from another folder: one line each that names the remedy."""

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from blur2view.runs.job import file_digest
from tests.support.calls import Call
from tests.support.many_photographs import write_photographs
from tests.support.tables import table


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of three small photographs."""
    return write_photographs(tmp_path / "in", 3)[0].parent


@pytest.mark.skipif(not Path("/proc/self/comm").exists(), reason="Linux alone has such files")
def test_file_that_says_it_is_empty_is_not_read(call: Call, tmp_path: Path) -> None:
    odd = Path("/proc/self/comm")  # /proc/kmsg, another one, would wait for ever
    assert odd.stat().st_size == 0 and odd.read_bytes()
    assert file_digest(odd) == hashlib.sha256(b"").hexdigest()
    done = call("estimate", odd)
    assert done == 1 and "is no regular file" in done.line


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
