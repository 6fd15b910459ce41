"""``--csv``: what the table holds, whatever the command, and what becomes of it when a run fails."""

import shutil
from pathlib import Path
from unittest.mock import Mock

import pytest

from blur2view import output_files
from blur2view.errors import OutputError, RunError
from blur2view.output_files import write_files
from blur2view.runs.manifest import Manifest
from tests.support.calls import Call
from tests.support.tables import COLUMNS, table


@pytest.mark.parametrize("command", ["estimate", "segment", "report", "to-colmap"])
def test_every_command_writes_the_same_rows(
    command: str, moving: Path, still: Path, call: Call, tmp_path: Path
) -> None:
    target = {"report": ["-o", tmp_path / "a.html"], "to-colmap": ["--db", tmp_path / "a.db"]}
    sheets = tmp_path / "triage.csv", tmp_path / "own.csv"
    camera = ("--focal", 300)
    assert call("triage", moving, still, *camera, "--csv", sheets[0]) == 0
    assert call(command, moving, still, *camera, "--csv", sheets[1], *target.get(command, [])) == 0
    first, second = map(table, sheets)
    for ours, own in zip(first, second, strict=True):
        assert {key: own[key] for key in COLUMNS[:11]} == {key: ours[key] for key in COLUMNS[:11]}
        assert own["use"] == ""
    assert float(first[0]["rotation_deg"]) >= 0


@pytest.mark.parametrize(
    ("command", "words"),
    [("report", ["-o", "a.html"]), ("triage", ["--keep", "a.html"]), ("to-colmap", ["--db", "a.html"])],
)
def test_table_that_cannot_be_written_costs_no_other_result(
    frames: Path, call: Call, tmp_path: Path, command: str, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(files: dict[Path, bytes]) -> None:
        if any(path.suffix == ".csv" for path in files):
            raise OSError(28, "No space left on device")
        write_files(files)

    monkeypatch.setattr(output_files, "write_files", full)
    words = [word.replace("a.html", str(tmp_path / "a.html")) for word in words]
    done = call(command, frames, *words, "--csv", tmp_path / "t.csv")
    assert done == 1 and "No space left on device" in done.line
    assert (tmp_path / "a.html").exists() and "t.csv" not in done.out


@pytest.mark.slow
@pytest.mark.parametrize(("command", "option"), [("triage", "--keep"), ("to-colmap", "--db")])
@pytest.mark.parametrize("error", [RunError("the cluster is gone"), OutputError("the manifest is full")])
def test_run_that_cannot_go_on_keeps_what_an_earlier_one_made_of_all(
    frames: Path, call: Call, tmp_path: Path, error: Exception, command: str, option: str
) -> None:
    words, made = (command, frames, option, tmp_path / "made"), tmp_path / "made"
    assert call(*words) == 0
    before = made.read_bytes()
    shutil.copy(frames / "still.png", frames / "another.png")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Manifest, "_write", Mock(side_effect=error))
        done = call(*words, "--resume")
    assert done == 1 and done.line == f"blur2view: {error}" and made.read_bytes() == before
    assert call(*words, "--resume") == 0 and made.read_bytes() != before
