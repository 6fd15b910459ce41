"""``--resume``: what is skipped, and what is done again."""

import json
from pathlib import Path

import numpy as np

from tests.support.calls import Call
from tests.support.colour_code import colour_code, write_picture
from tests.support.many_photographs import contents


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

    for damage in ({"smear_px": "long"}, {"wx": "fast"}, {"models": 3}, {"reason": None}):
        changed = json.loads(after["003b.json"]) | damage
        (out / "003b.json").write_text(json.dumps(changed, indent=2))
        assert run(folder, "-o", out, "--resume") == 0 and contents(out) == after

    whole = after["004.smear.npz"]
    for cut in (whole[:-9], whole[:-9] + b"otherwise"):
        (out / "004.smear.npz").write_bytes(cut)
        assert run(folder, "-o", out, "--resume") == 0 and contents(out) == after

    (out / "004.json").write_text("mine")
    assert run(folder, "-o", out, "--resume") == 1 and (out / "004.json").read_text() == "mine"


def test_other_options_are_done_again_and_those_without_effect_are_not(
    run: Call, folder: Path, tmp_path: Path, read: list[str]
) -> None:
    for count, words in enumerate(([], ["--seed", 3], ["--focal", 300]), start=1):
        for more in ([], ["--resume", "-q"]):
            assert run(folder, "-o", tmp_path / "out", "--resume", *words, *more) == 0
            assert len(read) == 5 * count


def test_table_of_a_resumed_call_is_that_of_a_whole_one(run: Call, folder: Path, here: Path) -> None:
    words = (folder, "-o", "out")
    assert run(*words, "--csv", "whole.csv") == 0
    assert run(*words, "--csv", "again.csv", "--resume") == 0
    assert Path("again.csv").read_bytes() == Path("whole.csv").read_bytes()


def test_a_photograph_is_done_again_where_a_neighbour_changed(
    run: Call, folder: Path, tmp_path: Path, read: list[str]
) -> None:
    words = (folder, "-o", tmp_path / "out", "--sequence")
    assert run(*words) == 0
    read.clear()
    write_picture(folder / "004.png", colour_code(np.zeros((64, 80, 2)), 1.0))
    assert run(*words, "--resume") == 0
    assert read == ["003.png", "004.png"]
