"""``--resume``: what is skipped, what is done again; what an earlier call left may be of anybody."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view import pipeline
from blur2view.errors import ImageError
from blur2view.images.image import read_pixels
from tests.support.calls import Call
from tests.support.colour_code import colour_code, write_picture
from tests.support.many_photographs import announcing, contents, write_photographs, write_video

MANIFEST = ".estimate.manifest.jsonl"
COMMANDS = {
    "estimate": (["estimate", "-o", "out", "--json"], f"out/{MANIFEST}"),
    "triage": (["triage", "--csv", "t.csv"], ".t.csv.manifest.jsonl"),
    "to-colmap": (["to-colmap", "--db", "new.db"], ".new.db.manifest.jsonl"),
}


@pytest.fixture
def again(tmp_path: Path, call: Call, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Return a command over two small photographs, here."""
    monkeypatch.chdir(tmp_path)
    write_photographs(tmp_path / "in", 2)
    return lambda command, *more: call(*COMMANDS[command][0], "in", *more)


def test_resume_does_only_what_is_new_changed_or_incomplete(
    run: Call, folder: Path, tmp_path: Path, read: list[str]
) -> None:
    out = tmp_path / "out"
    assert run(folder, "-o", out) == 0
    before = contents(out)
    read.clear()
    done = run(folder, "-o", out, "--resume", "-v")
    assert read == [] and contents(out) == before and done.err == ""
    assert "003.png: done before" in done.out and "5 photographs: 5 done before" in done.out

    (out / "000.png").unlink()
    (out / "001.json").write_bytes(before["001.json"][:-9])
    write_picture(folder / "002.png", colour_code(np.zeros((64, 80, 2)), 1.0))
    write_picture(folder / "900.png", colour_code(np.zeros((64, 80, 2)), 1.0))
    (folder / "003.png").rename(folder / "003b.png")
    assert run(folder, "-o", out, "--resume") == 0
    assert read == ["000.png", "001.png", "002.png", "003b.png", "900.png"]
    after = contents(out)
    assert after["000.png"] == before["000.png"] and after["002.smear.npz"] != before["002.smear.npz"]
    assert json.loads(after["001.json"])["config"] == json.loads(before["001.json"])["config"]

    (out / "004.json").write_text("mine")
    assert run(folder, "-o", out, "--resume") == 1 and (out / "004.json").read_text() == "mine"


@pytest.mark.parametrize("size", [0, -2])
@pytest.mark.parametrize("listed", [True, False])
def test_a_result_that_is_empty_or_cut_is_done_again(again: Call, size: int, listed: bool) -> None:
    assert again("estimate", "--no-timings") == 0
    whole = Path("out/000.json").read_bytes()
    Path("out/000.json").write_bytes(whole[:size])
    if not listed:
        Path(COMMANDS["estimate"][1]).unlink()
    done = again("estimate", "--resume", "--no-timings")
    assert (done, done.err) == (0, "") and Path("out/000.json").read_bytes() == whole


def test_a_file_of_others_that_begins_like_a_result_stays(again: Call) -> None:
    Path("out").mkdir()
    Path("out/000.json").write_text('{\n  "image": "mine"}')
    done = again("estimate")
    assert done == 1 and "000.json: is no result of an earlier call" in done.line


@pytest.mark.parametrize("option", [["--seed", 3], ["--no-timings"]])
def test_other_options_are_done_again_and_named(
    run: Call, folder: Path, tmp_path: Path, read: list[str], option: list[object]
) -> None:
    assert run(folder, "-o", tmp_path / "out") == 0
    read.clear()
    done = run(folder, "-o", tmp_path / "out", "--resume", *option)
    name = str(option[0]).removeprefix("--no-").removeprefix("--")
    assert len(read) == 5 and done.line.endswith(f"other options ({name}) made it; all is done again")
    assert run(folder, "-o", tmp_path / "out", "--resume", "--max-memory", 1, "-q", *option) == 0
    assert len(read) == 5


def test_each_output_of_triage_goes_on_from_what_was_done_for_another(again: Call, read: list[str]) -> None:
    assert again("triage") == 0
    read.clear()
    keep, best = ["--keep", "k.txt"], ["--best", 1, "--extract", "kept"]
    for more in (keep, [*keep, *best], []):
        done = again("triage", "--resume", *more)
        assert done == 0 and read == [] and "2 photographs (2 done before)" in done.out
    assert Path("k.txt").read_text() and len(os.listdir("kept")) == 1
    write_photographs(Path("in"), 3)
    assert again("triage", "--resume", *keep) == 0 and read == ["002.png"]
    assert again("triage", "--resume") == 0 and read == ["002.png"]


@pytest.mark.parametrize("command", ["estimate", "segment"])
def test_resume_replaces_no_result_of_another_photograph(
    call: Call, folder: Path, tmp_path: Path, command: str
) -> None:
    out, other = tmp_path / "out", tmp_path / "other" / "000.png"
    other.parent.mkdir()
    shutil.copy(folder / "001.png", other)
    assert call(command, folder / "000.png", "-o", out) == 0
    before = contents(out)
    done = call(command, other, "-o", out, "--resume")
    assert done == 1 and "would replace those of ../in/000.png" in done.line and contents(out) == before
    assert call(command, folder / "000.png", "-o", out, "--resume") == 0
    assert call(command, other, "-o", out, "--resume", "--overwrite") == 0 and contents(out) != before


def test_database_of_what_is_done_is_replaced_by_one_of_all(call: Call, folder: Path, tmp_path: Path) -> None:
    whole, new, one = tmp_path / "whole.db", tmp_path / "new.db", folder / "003.png"
    assert call("to-colmap", folder, "--db", whole) == 0
    good = one.read_bytes()
    one.write_text("bad")
    assert call("to-colmap", folder, "--db", new) == 1
    partial = new.read_bytes()
    one.write_bytes(good)
    assert call("to-colmap", folder, "--db", new, "--resume") == 0
    assert whole.read_bytes() == new.read_bytes() != partial
    new.write_bytes(b"theirs")
    for words in ([], ["--resume"]):
        done = call("to-colmap", folder, "--db", new, *words)
        assert done == 1 and "exists; choose another --db" in done.line
    assert new.read_bytes() == b"theirs"


def test_a_video_whose_last_failure_is_its_end_is_not_stopped(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = announcing(monkeypatch, write_video(tmp_path / "clip.mp4", 40), 41)
    (tmp_path / "bad.png").write_text("bad")

    def failing(path: Path, **options: Any) -> Any:
        if path.name == "000039":
            raise ImageError(f"{path}: fails")
        return read_pixels(path, **options)

    monkeypatch.setattr(pipeline, "read_pixels", failing)
    words = ("triage", clip, "--from", 38, "--max-failures", 1)
    done = call(*words)
    assert done == 1 and "stopped" not in done.err and "2 photographs" in done.out
    done = call(*words, tmp_path / "bad.png")
    assert done == 1 and "stopped after 2 of 4 photographs" in done.err
