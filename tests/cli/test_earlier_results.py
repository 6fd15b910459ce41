"""What an earlier call has left may be of anybody: it is read as values, or the work is done again."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from blur2view.runs.manifest import Manifest, Settings
from tests.support.calls import Call
from tests.support.many_photographs import contents, write_photographs

COMMANDS = {
    "estimate": (["estimate", "-o", "out", "--json"], "out/estimate.manifest.jsonl"),
    "report": (["report", "-o", "page.html", "--no-mask"], "page.html.manifest.jsonl"),
    "triage": (["triage", "--csv", "t.csv"], "t.csv.manifest.jsonl"),
    "to-colmap": (["to-colmap", "--db", "new.db"], "new.db.manifest.jsonl"),
}


@pytest.fixture
def again(tmp_path: Path, call: Call, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Return a command over two small photographs, here."""
    monkeypatch.chdir(tmp_path)
    write_photographs(tmp_path / "in", 2)
    return lambda command, *more: call(*COMMANDS[command][0], "in", *more)


def change(command: str, *keys: Any, value: Any) -> None:
    """Put another value into the line of the first photograph."""
    manifest = Path(COMMANDS[command][1])
    head, *lines = map(json.loads, manifest.read_text().splitlines())
    holder = lines[0]
    for key in keys[:-1]:
        holder = holder[key]
    holder[keys[-1]] = value
    manifest.write_text("".join(json.dumps(line) + "\n" for line in (head, *lines)))


@pytest.mark.parametrize(
    ("command", "keys", "value"),
    [
        ("estimate", ["row", "smear_px"], "far"),
        ("report", ["kept", "verdict"], "NONE"),
        ("report", ["kept", "content"], "[]"),
        ("report", ["kept", "content"], '{"document": "7"}'),
        ("report", ["kept", "median_px"], {"px": 3}),
        ("triage", ["row", "smear_px"], [3]),
        ("triage", ["summary"], 3),
        ("to-colmap", ["kept"], [None, None]),  # as a list was kept once
        ("to-colmap", ["kept", "name"], "001.png"),
        ("to-colmap", ["kept", "size"], [80, 10**30]),
        ("to-colmap", ["kept", "points_open", "shape"], [1, -1]),
        ("to-colmap", ["kept", "points_open", "dtype"], "|O"),
        ("to-colmap", ["kept", "points_close", "shape"], [9]),
        ("to-colmap", ["kept", "geometry", "config"], "NONE"),
        ("to-colmap", ["kept", "geometry", "inlier_mask"], [True]),
        ("to-colmap", ["kept", "camera"], {"model": "NONE"}),
    ],
)
def test_photograph_whose_line_was_changed_is_done_again(
    again: Call, tmp_path: Path, command: str, keys: list[Any], value: Any
) -> None:
    assert again(command) == 0
    before = contents(tmp_path)
    change(command, *keys, value=value)
    done = again(command, "--resume")
    assert done == 0 and all("done again" in line for line in done.lines)
    if command == "to-colmap":  # in which no time stands
        assert contents(tmp_path) == before
    if command == "triage":
        assert "2 photographs (1 done before)" in done.out


def test_page_of_a_changed_manifest_holds_no_other_markup(again: Call) -> None:
    assert again("report") == 0
    change("report", "kept", "thumbnail", value='"><script>alert(1)</script>')
    change("report", "kept", "kind", value='"><script>alert(2)</script>')
    assert again("report", "--resume") == 0
    assert "<script>alert" not in Path("page.html").read_text()


def test_control_characters_of_a_stored_summary_are_printed_as_escapes(again: Call) -> None:
    assert again("triage") == 0
    change("triage", "row", "meaning", value="a\x1b[31m.png: fine")
    change("triage", "row", "use", value="\x1b[32m")
    printed = again("triage", "--resume", "-v").out
    assert "a\\x1b[31m.png: fine" in printed and "\x1b" not in printed
    assert len(again("triage", "--resume").out.splitlines()) == 1  # nothing of each that was done before


@pytest.mark.parametrize("document", ["[" * 99999, '{"model_id": "", "image": "a\\u0000"}', "null"])
@pytest.mark.parametrize("listed", [True, False])
def test_documents_that_make_no_sense_are_made_again(again: Call, document: str, listed: bool) -> None:
    assert again("estimate") == 0
    Path("out/000.json").write_text('"model_id":' * (document != "null") + document)
    if listed:
        Path(COMMANDS["estimate"][1]).unlink()
    done = again("estimate", "--resume")
    assert len(done.lines) == int(done) == int(document == "null")  # which does not say that it is ours


def test_manifest_of_another_version_is_told_in_one_line(
    again: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert again("triage") == 0
    monkeypatch.setattr("blur2view.cli.work.__version__", "9.9")
    done = again("triage", "--resume")
    assert done == 0 and "2 photographs in " in done.out
    assert done.line.endswith("t.csv.manifest.jsonl: is of another version of blur2view; all is done again")


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", ["fifo", "/dev/zero"])
def test_manifest_that_is_no_file_is_one_line_before_any_work(
    again: Call, tmp_path: Path, command: str, kind: str
) -> None:
    manifest = Path(COMMANDS[command][1])
    manifest.parent.mkdir(exist_ok=True)
    if kind == "fifo":
        os.mkfifo(manifest)
    else:
        manifest.symlink_to(kind)
    for more in ([], ["--resume"]):
        done = again(command, *more)
        assert (done, done.out) == (1, "")
        assert "is no manifest of blur2view; rename or remove it" in done.line
    assert os.path.lexists(manifest) and len([one for one in tmp_path.iterdir() if one.is_file()]) == 0


def test_second_call_into_a_folder_is_refused_in_one_line_while_the_first_runs(again: Call) -> None:
    Path("out").mkdir()
    settings = Settings(command="estimate", version="1", options={})
    with Manifest(Path(COMMANDS["estimate"][1]), settings, resume=False):
        done = again("estimate", "--resume")
    assert done == 1 and "another call writes there" in done.line and '"estimates"' not in done.out
    assert again("estimate") == 0
