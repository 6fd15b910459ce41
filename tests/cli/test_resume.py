"""``--resume``: what is skipped, what is done again."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view import pipeline
from blur2view.photographs.image import read_image
from tests.support.calls import Call
from tests.support.colour_code import colour_code, write_picture
from tests.support.many_photographs import contents

MANIFEST = "estimate.manifest.jsonl"


def test_resume_does_only_what_is_new_changed_or_incomplete(
    run: Call, folder: Path, tmp_path: Path, read: list[str]
) -> None:
    out = tmp_path / "out"
    assert run(folder, "-o", out) == 0
    before = contents(out)
    read.clear()
    assert run(folder, "-o", out, "--resume") == 0
    assert read == [] and contents(out) == before

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


@pytest.mark.slow
@pytest.mark.parametrize("option", [["--seed", 3], ["--beta", 0.2], ["--focal", 160], ["--no-timings"]])
def test_other_options_are_done_again(
    run: Call, folder: Path, tmp_path: Path, read: list[str], option: list[object]
) -> None:
    assert run(folder, "-o", tmp_path / "out") == 0
    read.clear()
    assert run(folder, "-o", tmp_path / "out", "--resume", *option) == 0
    assert len(read) == 5
    assert run(folder, "-o", tmp_path / "out", "--resume", "--max-memory", 1, "-q", *option) == 0
    assert len(read) == 5


def test_other_network_is_done_again(
    run: Call, folder: Path, tmp_path: Path, read: list[str], tiny_model: Path
) -> None:
    shutil.copy(tiny_model, tmp_path / "copy.onnx")
    for model, count in ((tiny_model, 5), (tmp_path / "copy.onnx", 0), ("default", 5)):
        read.clear()
        assert run(folder, "-o", tmp_path / "out", "--resume", "--model", model) == 0
        assert len(read) == count


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
    assert done == 1 and f"is the result of {folder / '000.png'}" in done.line and contents(out) == before
    assert call(command, folder / "000.png", "-o", out, "--resume") == 0
    assert call(command, other, "-o", out, "--resume", "--overwrite") == 0 and contents(out) != before


def test_resume_does_again_what_has_another_name_now(
    run: Call, folder: Path, tmp_path: Path, read: list[str]
) -> None:
    other = tmp_path / "other" / "000.png"
    other.parent.mkdir()
    shutil.copy(folder / "001.png", other)
    out = tmp_path / "out"
    assert run(folder / "000.png", folder / "001.png", "-o", out) == 0
    read.clear()
    assert run(folder / "000.png", other, "-o", out, "--resume") == 0
    assert read == ["000.png", "000.png"]
    assert (out / "in" / "000.json").exists() and (out / "other" / "000.json").exists()


def test_resume_prints_the_documents_of_what_was_done_before(run: Call, folder: Path, tmp_path: Path) -> None:
    one, again = (run(folder, "-o", tmp_path / "out", "--resume", "--json") for _ in range(2))
    assert one.out == again.out and len(one.document["estimates"]) == 5


def test_photograph_alone_leaves_no_manifest_unless_it_is_to_be_resumed(
    run: Call, folder: Path, tmp_path: Path
) -> None:
    assert run(folder / "000.png", "-o", tmp_path / "out") == 0
    assert not (tmp_path / "out" / MANIFEST).exists()
    assert run(folder / "000.png", "-o", tmp_path / "out", "--resume") == 0
    assert (tmp_path / "out" / MANIFEST).exists()


def test_page_goes_on_where_other_photographs_change_the_shown_names(
    call: Call, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, other = tmp_path / "page.html", tmp_path / "other"
    words = ("--no-mask", "--no-timings", "-o", page)
    given = [folder / name for name in ("000.png", "001.png")]
    assert call("report", *words, *given) == 0
    other.mkdir()
    (other / "000.png").write_bytes((folder / "002.png").read_bytes())
    given.append(other / "000.png")
    read: list[str] = []

    def noted(path: Path, **options: Any) -> Any:
        read.append(path.parent.name)
        return read_image(path, **options)

    monkeypatch.setattr(pipeline, "read_image", noted)
    assert call("report", *words, *given, "--resume") == 0
    assert read == ["other"]
    resumed = page.read_bytes()
    assert call("report", *words, *given, "--overwrite") == 0
    assert page.read_bytes() == resumed and f'data-name="{folder.name}/000.png"'.encode() in resumed


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


def test_resume_with_fewer_photographs_drops_none(call: Call, folder: Path, here: Path) -> None:
    target = ["--db", "new.db"]
    photographs = [folder / name for name in ("000.png", "001.png", "002.png")]
    assert call("to-colmap", *target, *photographs) == 0
    before = contents(here)
    told = "the views of 1 photograph (002.png) would be lost, as this call names them otherwise"
    done = call("to-colmap", *target, *photographs[:2], "--resume")
    assert done == 1 and told in done.err and contents(here) == before
    whole = photographs[2].read_bytes()
    photographs[2].write_text("bad")
    done = call("to-colmap", *target, *photographs, "--resume")
    assert done == 1 and told in done.err
    photographs[2].write_bytes(whole)
    assert call("to-colmap", *target, *photographs, folder / "003.png", "--resume") == 0
